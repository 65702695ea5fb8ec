"""Compiled mathematics on plain arrays: elliptic functions, one rod, closure, Newton, stability, continuation."""
