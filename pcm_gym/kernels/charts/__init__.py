"""Charts of stable equilibria: floods over rasters, roadmaps, paths and walks."""
