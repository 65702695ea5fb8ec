"""Compiled mathematics on plain arrays, in rooms; each knows only those named before it.

numerics, rods, statics, branches; then two wings: enumeration and proofs find all equilibria, snaps, lockstep and
stepping follow one. Charts stand on top.
"""
