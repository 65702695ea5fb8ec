"""One mechanism at rest: closure and equilibrium, Newton's method, stability, margins, and what is known of it.

Symbols: x the state (per leg g, then the pose), B the clamp, p the tip from the clamp, f the force on the tip, c the
arm from the end-effector's origin to the hinge, A = d f / d p of a rod, K the stiffness of the end-effector, k an
eigenvalue of K and v its eigenvector. Lengths and forces are dimensionless.

To be read in this order: `formulas` (each equation once), `closure` (tables, residual and linear systems), `newton`,
`stability` (Morse index and stability margin), `margin` (distance from a fold), `equilibrium` (all of it for one
state), `states` (a batch of states, and when two are one).
"""
