"""Solving mechanisms: equilibria, branches, stability."""

from pcm_gym.solving.atlas import Atlas, Branch, load_atlas
from pcm_gym.solving.charting import build_atlas
from pcm_gym.solving.enumeration import solve_forward, solve_inverse
from pcm_gym.solving.equilibrium import Equilibrium, RodState
from pcm_gym.solving.home import home_equilibrium
from pcm_gym.solving.raster import Raster, Region
from pcm_gym.solving.raster_states import RasterStates
from pcm_gym.solving.relaxation import Snap, SnapStatus, snap
from pcm_gym.solving.solutions import EquilibriumSet, StableStates
from pcm_gym.solving.tracking import BranchTracker, Event, TrackedStep

__all__ = [
    "Atlas",
    "Branch",
    "BranchTracker",
    "Equilibrium",
    "EquilibriumSet",
    "Event",
    "Raster",
    "RasterStates",
    "Region",
    "RodState",
    "Snap",
    "SnapStatus",
    "StableStates",
    "TrackedStep",
    "build_atlas",
    "home_equilibrium",
    "load_atlas",
    "snap",
    "solve_forward",
    "solve_inverse",
]
