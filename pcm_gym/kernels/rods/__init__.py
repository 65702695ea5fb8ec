"""One rod: elliptic functions, then a rod's tip, force, derivatives, shape and energy from the load at its tip."""
