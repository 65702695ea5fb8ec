"""A page for each registered environment, from its docstrings and from itself: ``python -m docs.environments``."""
