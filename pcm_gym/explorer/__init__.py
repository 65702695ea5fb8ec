"""A page to explore a mechanism by hand: every equilibrium, folds, snaps and bifurcation diagrams.

`messages` says what a browser may ask, `session` answers for one browser, `views` turns what the package finds into
data, and `server` carries both over a socket, on this machine alone (needs websockets, the extra ``explore``). The page
itself is in ``static``. No mechanics is here: a session asks `pcm_gym.solving` for all of it.
"""
