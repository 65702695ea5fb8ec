"""Solving mechanisms: equilibria, branches, stability."""

from pcm_gym.solving.certification import Certificate, UndecidedRegion
from pcm_gym.solving.enumeration import solve_forward, solve_inverse
from pcm_gym.solving.equilibrium import Equilibrium, RodState
from pcm_gym.solving.home import home_equilibrium
from pcm_gym.solving.solutions import EquilibriumSet
from pcm_gym.solving.tracking import BranchTracker, Event, TrackedStep

__all__ = [
    "BranchTracker",
    "Certificate",
    "Equilibrium",
    "EquilibriumSet",
    "Event",
    "RodState",
    "TrackedStep",
    "UndecidedRegion",
    "home_equilibrium",
    "solve_forward",
    "solve_inverse",
]
