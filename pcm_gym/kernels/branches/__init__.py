"""Branches of equilibria: continuation along a line, singular states, and curves of them."""
