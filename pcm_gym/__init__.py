"""Exact kinematics and Gymnasium environments of planar parallel continuum mechanisms.

Importing the package registers its environments: ``gymnasium.make("PCM/2RFR-Reach-v0")``.
"""

from pcm_gym.environments import environment_ids, register_environments
from pcm_gym.mechanism import Leg, Mechanism, Prismatic, Revolute, Rod, get_mechanism, mechanism_names
from pcm_gym.solving import (
    BranchTracker,
    Certificate,
    Equilibrium,
    EquilibriumSet,
    Event,
    RodState,
    TrackedStep,
    UndecidedRegion,
    home_equilibrium,
    solve_forward,
    solve_inverse,
)
from pcm_gym.tasks import Element, observation_elements

__all__ = [
    "BranchTracker",
    "Certificate",
    "Element",
    "Equilibrium",
    "EquilibriumSet",
    "Event",
    "Leg",
    "Mechanism",
    "Prismatic",
    "Revolute",
    "Rod",
    "RodState",
    "TrackedStep",
    "UndecidedRegion",
    "environment_ids",
    "get_mechanism",
    "home_equilibrium",
    "mechanism_names",
    "observation_elements",
    "solve_forward",
    "solve_inverse",
]

register_environments()
