"""Compiled mathematics on plain arrays, in rooms; each knows only those named before it.

numerics, rods, statics; structure and branches, which do not know each other; then two wings: enumeration and proofs
find all equilibria, snaps, lockstep and stepping follow one. Charts stand on top.
"""
