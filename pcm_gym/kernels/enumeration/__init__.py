"""All equilibria: at given inputs, and at a given pose.

Read `cells` first: the plane of one rod's equilibria, graded, and what a leg offers over it at a pose. `sheets` cuts
that plane by the rod's tip instead. `found` polishes what the searches propose and keeps each equilibrium once;
`forward_search` (inputs given, over poses, by sheets) and `inverse_search` (pose given, by a join of the legs' trees of
cells) propose. `linearisation` scales the equations near a state, for what is not isolated.

Symbols
-------
rho : dimensionless load L sqrt(|f| / EI) of a rod; g = rho^2 (cos b, -sin b) is the load as its tip sees it.
b : angle from the tip force to the tangent at the tip, rad; `side` 0 for b > 0, 1 for b < 0; `grade` in [0, 1] of |b|.
s, t : local coordinates of a cell along rho and b, in [-1, 1].
f, f_x, f_y : force of the end-effector on a tip; offers are those of a leg on the end-effector, world frame.
"""
