"""Who acts: the controllers of `pcm_gym.references`, and what has learnt, under one table of names.

To be read in this order: `trained`, `table`.
"""
