"""How fast the environments are, beside others, on the machine at hand. Nothing here passes or fails."""
