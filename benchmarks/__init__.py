"""How fast environments and solvers are, beside others, on the machine at hand. Nothing here passes or fails."""
