"""Exact kinematics and Gymnasium environments of planar parallel continuum mechanisms.

Importing the package registers its environments: ``gymnasium.make("PCM/2RFR-Reach-v0")``.
"""

import sys
from typing import TYPE_CHECKING

if sys.version_info < (3, 11):  # noqa: UP036 (which is when this is for: a checkout in another interpreter's path)
    raise ImportError(f"pcm_gym needs Python 3.11 or newer, this is Python {sys.version_info[0]}.{sys.version_info[1]}")

from pcm_gym.environments.registration import register_environments
from pcm_gym.lazy import attribute_loader

if TYPE_CHECKING:
    from pcm_gym.environments import (
        EnvironmentArguments,
        Info,
        MechanismEnv,
        MechanismVectorEnv,
        Preview,
        environment_ids,
        register_environment,
    )
    from pcm_gym.mechanism import (
        FIBREGLASS,
        NITINOL,
        SPRING_STEEL,
        Leg,
        Material,
        Mechanism,
        MechanismFileError,
        Prismatic,
        Revolute,
        Rod,
        Round,
        Strip,
        get_mechanism,
        load_mechanism,
        mechanism_names,
        register_mechanism,
        save_mechanism,
    )
    from pcm_gym.solving import (
        Atlas,
        AtlasError,
        Branch,
        BranchTracker,
        Certificate,
        CriticalLoad,
        Crossing,
        CurveEnd,
        Equilibrium,
        EquilibriumSet,
        Event,
        Family,
        FamilyKind,
        Motion,
        MotionPlanner,
        NearestFold,
        Obstacle,
        PathCertificate,
        PlanningError,
        RasterStates,
        Region,
        Roadmap,
        RodCrossing,
        RodState,
        SearchBudgetError,
        SingularCurve,
        Snap,
        SnapStatus,
        StableStates,
        StructuralLimits,
        TrackedStep,
        UndecidedRegion,
        build_atlas,
        build_roadmap,
        certify_path,
        critical_load,
        find_crossings,
        find_falls,
        forward_singularities,
        home_equilibrium,
        inverse_singularities,
        load_atlas,
        nearest_fold,
        plan_motion,
        search_budget,
        snap,
        solve_forward,
        solve_inverse,
    )
    from pcm_gym.tasks import (
        Element,
        Episodes,
        Goals,
        Scene,
        Task,
        observation_elements,
        register_task,
    )
    from pcm_gym.wrappers import CostStep, SolverShield, VectorSolverShield

__version__ = "0.1.0"

__all__ = [
    "FIBREGLASS",
    "NITINOL",
    "SPRING_STEEL",
    "Atlas",
    "AtlasError",
    "Branch",
    "BranchTracker",
    "Certificate",
    "CostStep",
    "CriticalLoad",
    "Crossing",
    "CurveEnd",
    "Element",
    "EnvironmentArguments",
    "Episodes",
    "Equilibrium",
    "EquilibriumSet",
    "Event",
    "Family",
    "FamilyKind",
    "Goals",
    "Info",
    "Leg",
    "Material",
    "Mechanism",
    "MechanismEnv",
    "MechanismFileError",
    "MechanismVectorEnv",
    "Motion",
    "MotionPlanner",
    "NearestFold",
    "Obstacle",
    "PathCertificate",
    "PlanningError",
    "Preview",
    "Prismatic",
    "RasterStates",
    "Region",
    "Revolute",
    "Roadmap",
    "Rod",
    "RodCrossing",
    "RodState",
    "Round",
    "Scene",
    "SearchBudgetError",
    "SingularCurve",
    "Snap",
    "SnapStatus",
    "SolverShield",
    "StableStates",
    "Strip",
    "StructuralLimits",
    "Task",
    "TrackedStep",
    "UndecidedRegion",
    "VectorSolverShield",
    "__version__",
    "build_atlas",
    "build_roadmap",
    "certify_path",
    "critical_load",
    "environment_ids",
    "find_crossings",
    "find_falls",
    "forward_singularities",
    "get_mechanism",
    "home_equilibrium",
    "inverse_singularities",
    "load_atlas",
    "load_mechanism",
    "mechanism_names",
    "nearest_fold",
    "observation_elements",
    "plan_motion",
    "register_environment",
    "register_mechanism",
    "register_task",
    "save_mechanism",
    "search_budget",
    "snap",
    "solve_forward",
    "solve_inverse",
]

if not TYPE_CHECKING:  # type checkers know the names above and no others
    # What stands in a room is imported when it is first asked for; each room imports those before it anyway.
    __getattr__ = attribute_loader(
        __name__,
        __all__,
        rooms=("kernels", "mechanism", "solving", "tasks", "environments", "wrappers", "references", "rendering"),
    )


def __dir__() -> list[str]:
    return __all__


register_environments()
