"""The figures of Altuzarra et al. (2019), made anew by the package's own solver: ``python -m docs.figures``."""
