"""Charts of stable equilibria, made of many steps from state to state.

A raster cuts inputs or poses into cells; a node is an equilibrium at a cell's centre, a way leads from one to a
neighbour. A sheet is a smooth piece of the set of stable equilibria, a branch what a stable path connects.

To be read in this order: `flood` (sheets over inputs and poses), `roadmap` (nodes and the steps between them),
`distances` (how many steps lead from node to node), `walks` (from nodes towards inputs), `paths` (along given poses).
"""
