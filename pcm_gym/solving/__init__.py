"""Solving mechanisms: equilibria, branches, stability."""

from pcm_gym.solving.atlas import Atlas, Branch, load_atlas
from pcm_gym.solving.certification import Certificate, UndecidedRegion
from pcm_gym.solving.charting import build_atlas
from pcm_gym.solving.crossings import Crossing, find_crossings
from pcm_gym.solving.enumeration import solve_forward, solve_inverse
from pcm_gym.solving.equilibrium import Equilibrium, RodState
from pcm_gym.solving.fold_distance import NearestFold, nearest_fold
from pcm_gym.solving.home import home_equilibrium
from pcm_gym.solving.raster import Raster, Region
from pcm_gym.solving.raster_states import RasterStates
from pcm_gym.solving.relaxation import Snap, SnapStatus, snap
from pcm_gym.solving.roadmap import Roadmap, build_roadmap, find_falls
from pcm_gym.solving.singular_curve import CurveEnd, SingularCurve
from pcm_gym.solving.singularities import forward_singularities, inverse_singularities
from pcm_gym.solving.solutions import EquilibriumSet, StableStates
from pcm_gym.solving.tracking import BranchTracker, Event, TrackedStep

__all__ = [
    "Atlas",
    "Branch",
    "BranchTracker",
    "Certificate",
    "Crossing",
    "CurveEnd",
    "Equilibrium",
    "EquilibriumSet",
    "Event",
    "NearestFold",
    "Raster",
    "RasterStates",
    "Region",
    "Roadmap",
    "RodState",
    "SingularCurve",
    "Snap",
    "SnapStatus",
    "StableStates",
    "TrackedStep",
    "UndecidedRegion",
    "build_atlas",
    "build_roadmap",
    "find_crossings",
    "find_falls",
    "forward_singularities",
    "home_equilibrium",
    "inverse_singularities",
    "load_atlas",
    "nearest_fold",
    "snap",
    "solve_forward",
    "solve_inverse",
]
