"""All equilibria: at given inputs, and at a given pose."""
