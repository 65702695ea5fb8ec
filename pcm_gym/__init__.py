"""Exact kinematics and Gymnasium environments of planar parallel continuum mechanisms.

Importing the package registers its environments: ``gymnasium.make("PCM/2RFR-Reach-v0")``.
"""

from pcm_gym.environments import CostStep, SolverShield, environment_ids, register_environments
from pcm_gym.mechanism import Leg, Mechanism, Prismatic, Revolute, Rod, get_mechanism, mechanism_names
from pcm_gym.solving import (
    Atlas,
    Branch,
    BranchTracker,
    Equilibrium,
    EquilibriumSet,
    Event,
    RasterStates,
    Region,
    RodState,
    Snap,
    SnapStatus,
    StableStates,
    TrackedStep,
    build_atlas,
    home_equilibrium,
    load_atlas,
    snap,
    solve_forward,
    solve_inverse,
)
from pcm_gym.tasks import Element, observation_elements

__all__ = [
    "Atlas",
    "Branch",
    "BranchTracker",
    "CostStep",
    "Element",
    "Equilibrium",
    "EquilibriumSet",
    "Event",
    "Leg",
    "Mechanism",
    "Prismatic",
    "RasterStates",
    "Region",
    "Revolute",
    "Rod",
    "RodState",
    "Snap",
    "SnapStatus",
    "SolverShield",
    "StableStates",
    "TrackedStep",
    "build_atlas",
    "environment_ids",
    "get_mechanism",
    "home_equilibrium",
    "load_atlas",
    "mechanism_names",
    "observation_elements",
    "snap",
    "solve_forward",
    "solve_inverse",
]

register_environments()
