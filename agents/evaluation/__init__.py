"""Judging controllers with the exact solver in the loop, on goals that no training has seen.

To be read in this order: `episodes` is what one episode comes to, `rollouts` runs many side by side on the native
batch, and `first_successes` watches when they succeed. `estimates` are intervals, `summaries` what a controller's
episodes come to together, `comparison` sets controllers beside each other on the same episodes, and `tables` writes it
all.
"""
