"""Snaps: what happens where stability is lost, overdamped motion of whole rods to where they come to rest.

To be read in this order:

1. `moving_rods`: the rods in motion, discretised, and one implicit step of their motion.
2. `relaxation`: from an equilibrium by steps down its energy to a stable one.
3. `snap`: a relaxation with the grids and rules by which mechanisms snap.
4. `instability`: what a mechanism that is moved does where it loses stability: end, hold, snap or go on.

Symbols: i counts the legs, p and q the nodes of a rod, which are Gauss points of its arc; ANGLE, the unknown, is the
angle of the tangent at a node from that at the clamp; `hardness` is drag over the time of a step, `gaps` are the errors
of closure and `forces` their multipliers, the end-effector's forces on the tips.
"""
