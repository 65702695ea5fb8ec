"""What a mechanism must endure: curvature of its rods, actuator forces, and where its parts cross.

To be read in this order:

1. `strength`: largest curvature of a rod, and what each actuator gives, from the rod table.
2. `loops`: where a rod crosses itself.
3. `arcs`: where two rods, or a rod and an edge of the platform, cross.
4. `contact`: the same of whole mechanisms, one or many.

Symbols: those of `rods.rod`; u = omega times arc length back from the tip, K the quarter period, sn, cn, dn and E(u)
Jacobi's functions and epsilon function for the parameter m.
"""
