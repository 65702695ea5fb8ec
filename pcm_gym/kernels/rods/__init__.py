"""One rod: everything that it does, from the load at its tip.

Symbols: g the load as the tip sees it, rho and b its polar coordinates (rho^2 = |g|), beta the angle from the force to
the tangent, kappa = cos(b/2), m = kappa^2 the parameter of Jacobi's functions, eta = d beta0 / d b. Lengths are in
units of L, forces in units of EI/L^2.

To be read in this order: `elliptic` (Jacobi's functions in one recursion), `rod` (tip, force and their derivatives,
index, energy, shape), `curvature` (second derivatives).
"""
