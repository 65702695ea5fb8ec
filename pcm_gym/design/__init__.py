"""Designs: how equilibria change with them, which one was measured, and which one is better.

Read `parameters` first: the numbers of a design, by name. `derivatives` are those of an equilibrium by them, exact;
`following` leads an equilibrium from one design to another. On these stand `calibration`, from measured poses, and
`optimisation`.
"""

from pcm_gym.design.calibration import Calibration, Measurements, calibrate
from pcm_gym.design.derivatives import DesignDerivatives, design_derivatives
from pcm_gym.design.following import DesignError, follow_design
from pcm_gym.design.optimisation import OptimisedDesign, optimise_design
from pcm_gym.design.parameters import DesignParameter, change_design

__all__ = [
    "Calibration",
    "DesignDerivatives",
    "DesignError",
    "DesignParameter",
    "Measurements",
    "OptimisedDesign",
    "calibrate",
    "change_design",
    "design_derivatives",
    "follow_design",
    "optimise_design",
]
