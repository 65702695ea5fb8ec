"""Branches of equilibria: continuation along a line, singular states, and curves of them.

To be read in this order:

1. `singularity`: what makes a state singular, and the metric in which changes of the unknowns are measured.
2. `tracer`: pseudo-arclength continuation of any smooth curve of equilibria.
3. `smoothness`: whether one smooth branch leads from one end of a step to the other.
4. `steps`: one step along a straight line in inputs and load, natural or by arc.
5. `continuation`: one branch along such a line, with its events.
6. `problem`, `curves`: singular curves, and the equilibria on a line or along a way, on which they are sought or met;
   where the polygons through their vertices cross, `polygons` tells.
7. `ways`: what is known of the points of a way, and the branches that meet in one.

Symbols, the same in all of them:

| symbol | meaning |
|---|---|
| x | state: the rods' loads g, and the pose, see `statics.closure` |
| s | fraction of the way along a line, in [0, 1] |
| y | unknowns: (x, s) on a line, (x, p) on a curve, whose parameters p are the inputs or one along a way |
| t, `tangent` | unit tangent at the last point y |
| M | metric; `border` is M t, so that the plane across the tangent is border . (y' - y) = arc |
| `arc` | distance along the tangent from the last point |
| `trial` | point that may become the next one |
"""
