"""Solving mechanisms: equilibria, branches, stability."""

from pcm_gym.solving.enumeration import solve_forward, solve_inverse
from pcm_gym.solving.equilibrium import Equilibrium, RodState
from pcm_gym.solving.home import home_equilibrium
from pcm_gym.solving.relaxation import Snap, SnapStatus, snap
from pcm_gym.solving.solutions import EquilibriumSet
from pcm_gym.solving.tracking import BranchTracker, Event, TrackedStep

__all__ = [
    "BranchTracker",
    "Equilibrium",
    "EquilibriumSet",
    "Event",
    "RodState",
    "Snap",
    "SnapStatus",
    "TrackedStep",
    "home_equilibrium",
    "snap",
    "solve_forward",
    "solve_inverse",
]
