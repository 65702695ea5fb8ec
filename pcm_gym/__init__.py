"""Exact kinematics and Gymnasium environments of planar parallel continuum mechanisms."""

from pcm_gym.mechanism import Leg, Mechanism, Prismatic, Revolute, Rod, get_mechanism, mechanism_names
from pcm_gym.solving import BranchTracker, Equilibrium, Event, RodState, TrackedStep, home_equilibrium

__all__ = [
    "BranchTracker",
    "Equilibrium",
    "Event",
    "Leg",
    "Mechanism",
    "Prismatic",
    "Revolute",
    "Rod",
    "RodState",
    "TrackedStep",
    "get_mechanism",
    "home_equilibrium",
    "mechanism_names",
]
