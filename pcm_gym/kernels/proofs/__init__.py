"""Proofs that a set of equilibria is complete, and that a path is one branch: Taylor models, Krawczyk's test.

Read from below: `taylor_models` (arithmetic that encloses its results), `rod_enclosure` (the closed form of a rod in
it), `rod_cells` (a tree of cells of the unit rod, and how it enters the equations of two legs), `krawczyk` (a box with
exactly one equilibrium), `certification` (branch and bound over pairs of cells: sets of two legs, at given inputs or at
a pose), `proved_states` (how far states are from the equilibria in the boxes). For paths, with any number of legs:
`tube` (one equilibrium at every place of a piece of a line), `path_proof` (pieces joined to a path).

Symbols
-------
rho, b : polar coordinates of a rod's load g = rho^2 (cos b, -sin b), as in `enumeration`.
s, t : local coordinates of a cell along rho and b, in [-1, 1]; models are polynomials in them with a remainder.
z : the unknowns, the loads of both rods, (4,), each rod's in its own chart; r : half widths of a box around it.
F, J, Y : the equations (force balance, then closure), their Jacobian, an approximate inverse of it.
"""
