"""Solving mechanisms: equilibria, branches, stability.

Read `equilibrium` first, the value that all others take and return. `enumeration` finds every one at given inputs or at
a given pose (`solutions`: sets of them; `families`: those that are not isolated; `search_frame`: in which units;
`certification`: the proof that a set is complete), and `home` chooses one.
`tracking` follows one along a way (`path_certification`: the proof that it did), `relaxation` lets it fall,
`fold_distance` measures how far it is from falling in the inputs, `critical_loads` in the loads (`fold_search`: how).
`singularities` searches for the curves where equilibria meet (`singular_curve`; `crossings`: where they cross), and
`bifurcation` for all branches along a line (`diagram`: what it finds; `branch_points`: which directions lead away from
one; `traced`: how both trace curves). Maps of all stable ones: the `roadmap` over inputs, for agents, and the `atlas`
over inputs and poses, made by `charting` on rasters (`raster`, `raster_states`, `atlas_file`). On roadmaps `planning`
finds a `motion` (`motion_goals`: to where; `roadmap_search`: over which nodes; `straight_ways`: how it is shortened and
verified). `progress` shows how far a search is.

Symbols
-------
d : degrees of freedom of the end-effector: 2, (x, y), or 3, (x, y, phi).
state, x : the kernels' dimensionless state, (2 legs + d,): the load of each rod as its tip sees it, then the pose.
y, unknowns : state and dimensionless inputs in one vector, (2 legs + d + legs,).
rho, rho_max : dimensionless load L sqrt(|f| / EI) of a rod, and the largest one looked for.

Public functions take and return N, m and rad. `Units` leads into the kernels, and out of them, at their door; an
`Equilibrium` goes in by its `kernel_values`.
"""

from typing import TYPE_CHECKING

from pcm_gym.lazy import exact_loader

if TYPE_CHECKING:
    from pcm_gym.solving.atlas import Atlas, Branch, load_atlas
    from pcm_gym.solving.atlas_file import AtlasError
    from pcm_gym.solving.bifurcation import bifurcation_diagram
    from pcm_gym.solving.budget import SearchBudgetError, search_budget
    from pcm_gym.solving.certification import Certificate, UndecidedRegion
    from pcm_gym.solving.charting import build_atlas
    from pcm_gym.solving.critical_loads import CriticalLoad, critical_load
    from pcm_gym.solving.crossings import Crossing, find_crossings
    from pcm_gym.solving.diagram import BifurcationDiagram, DiagramBranch, Slice, SpecialKind, SpecialPoint, Way
    from pcm_gym.solving.enumeration import solve_forward, solve_inverse
    from pcm_gym.solving.equilibrium import Equilibrium, RodCrossing, RodState
    from pcm_gym.solving.fold_distance import NearestFold, nearest_fold
    from pcm_gym.solving.home import home_equilibrium
    from pcm_gym.solving.limits import StructuralLimits
    from pcm_gym.solving.motion import Motion, Obstacle, PlanningError
    from pcm_gym.solving.path_certification import PathCertificate, certify_path
    from pcm_gym.solving.planning import MotionPlanner, plan_motion
    from pcm_gym.solving.raster import Raster, Region
    from pcm_gym.solving.raster_states import RasterStates
    from pcm_gym.solving.relaxation import Snap, SnapStatus, snap
    from pcm_gym.solving.roadmap import Roadmap, build_roadmap, find_falls
    from pcm_gym.solving.singular_curve import CurveEnd, SingularCurve
    from pcm_gym.solving.singularities import forward_singularities, inverse_singularities
    from pcm_gym.solving.solutions import EquilibriumSet, Family, FamilyKind, StableStates
    from pcm_gym.solving.tracking import BranchTracker, Event, TrackedStep

__all__ = [
    "Atlas",
    "AtlasError",
    "BifurcationDiagram",
    "Branch",
    "BranchTracker",
    "Certificate",
    "CriticalLoad",
    "Crossing",
    "CurveEnd",
    "DiagramBranch",
    "Equilibrium",
    "EquilibriumSet",
    "Event",
    "Family",
    "FamilyKind",
    "Motion",
    "MotionPlanner",
    "NearestFold",
    "Obstacle",
    "PathCertificate",
    "PlanningError",
    "Raster",
    "RasterStates",
    "Region",
    "Roadmap",
    "RodCrossing",
    "RodState",
    "SearchBudgetError",
    "SingularCurve",
    "Slice",
    "Snap",
    "SnapStatus",
    "SpecialKind",
    "SpecialPoint",
    "StableStates",
    "StructuralLimits",
    "TrackedStep",
    "UndecidedRegion",
    "Way",
    "bifurcation_diagram",
    "build_atlas",
    "build_roadmap",
    "certify_path",
    "critical_load",
    "find_crossings",
    "find_falls",
    "forward_singularities",
    "home_equilibrium",
    "inverse_singularities",
    "load_atlas",
    "nearest_fold",
    "plan_motion",
    "search_budget",
    "snap",
    "solve_forward",
    "solve_inverse",
]

if not TYPE_CHECKING:
    # What environments need comes without searches, charts and proofs, and so do programs that begin with one.
    __getattr__ = exact_loader(
        __name__,
        {
            "atlas": ("Atlas", "Branch", "load_atlas"),
            "atlas_file": ("AtlasError",),
            "bifurcation": ("bifurcation_diagram",),
            "budget": ("SearchBudgetError", "search_budget"),
            "certification": ("Certificate", "UndecidedRegion"),
            "charting": ("build_atlas",),
            "critical_loads": ("CriticalLoad", "critical_load"),
            "crossings": ("Crossing", "find_crossings"),
            "diagram": ("BifurcationDiagram", "DiagramBranch", "Slice", "SpecialKind", "SpecialPoint", "Way"),
            "enumeration": ("solve_forward", "solve_inverse"),
            "equilibrium": ("Equilibrium", "RodCrossing", "RodState"),
            "fold_distance": ("NearestFold", "nearest_fold"),
            "home": ("home_equilibrium",),
            "limits": ("StructuralLimits",),
            "motion": ("Motion", "Obstacle", "PlanningError"),
            "path_certification": ("PathCertificate", "certify_path"),
            "planning": ("MotionPlanner", "plan_motion"),
            "raster": ("Raster", "Region"),
            "raster_states": ("RasterStates",),
            "relaxation": ("Snap", "SnapStatus", "snap"),
            "roadmap": ("Roadmap", "build_roadmap", "find_falls"),
            "singular_curve": ("CurveEnd", "SingularCurve"),
            "singularities": ("forward_singularities", "inverse_singularities"),
            "solutions": ("EquilibriumSet", "Family", "FamilyKind", "StableStates"),
            "tracking": ("BranchTracker", "Event", "TrackedStep"),
        },
    )
