"""Proofs that a set of equilibria is complete: Taylor models, enclosures of rods, Krawczyk."""
