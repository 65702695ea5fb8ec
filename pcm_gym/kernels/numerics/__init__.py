"""Numerical ground: compilation and its cache, threads, small linear systems, rasters."""
