"""Goals of motions: what may be asked for, and which equilibria meet it."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np
from numpy.typing import ArrayLike

from pcm_gym.arrays import Array
from pcm_gym.kernels.charts.motions import settle
from pcm_gym.kernels.statics.states import States
from pcm_gym.mechanism import Mechanism
from pcm_gym.mechanism.validation import finite_vector, one_of, shown
from pcm_gym.solving.enumeration import solve_forward, solve_inverse
from pcm_gym.solving.equilibrium import Equilibrium
from pcm_gym.solving.limits import StructuralLimits
from pcm_gym.solving.motion import Obstacle, PlanningError

Goal = ArrayLike | Mapping[str, ArrayLike] | Equilibrium


@dataclass(frozen=True)
class Wanted:
    """What a motion is to lead to: an equilibrium, or one with this pose, with these inputs, or nearly with both.

    Attributes
    ----------
    pose : array (d,), optional
        m and rad.
    inputs : array (legs,), optional
        rad or m.
    equilibrium : Equilibrium, optional
    """

    pose: Array | None = None
    inputs: Array | None = None
    equilibrium: Equilibrium | None = None

    @classmethod
    def of(cls, goal: Goal, mechanism: Mechanism, name: str = "goal") -> "Wanted":
        """Return what a goal asks for; an equilibrium of another mechanism is carried over. `name` is for errors."""
        if isinstance(goal, Equilibrium):
            return cls(equilibrium=goal if goal.mechanism == mechanism else carried_over(goal, mechanism, name))
        if not isinstance(goal, Mapping):
            return cls(pose=finite_vector(name, goal, mechanism.dof))
        sizes = {"pose": mechanism.dof, "inputs": mechanism.leg_count}
        given = {one_of(f"{name} key", key, tuple(sizes)): value for key, value in goal.items()}
        if not given:
            raise ValueError(f"{name} must tell a pose or inputs, got {shown(goal)}")
        checked = {key: finite_vector(f"{name}[{key!r}]", value, sizes[key]) for key, value in given.items()}
        return cls(checked.get("pose"), checked.get("inputs"))

    @property
    def is_exact(self) -> bool:
        """Whether all equilibria at the inputs must be known to tell which one is meant."""
        return self.pose is not None and self.inputs is not None

    def _distance(self, equilibrium: Equilibrium) -> float:
        pose = equilibrium.pose if self.pose is None else self.pose
        return float(np.linalg.norm(equilibrium.mechanism.units.kernel_from_pose(equilibrium.pose - pose)))

    def equilibria(self, structure: StructuralLimits, load: Array, least_margin: float) -> list[Equilibrium]:
        """Return all stable equilibria that meet the goal within all limits and with the margin.

        Raises
        ------
        PlanningError
            If there are none.
        """
        found, what = self._all(structure.mechanism, load)
        if not found:
            raise PlanningError(Obstacle.OUT_OF_REACH, what)
        stable = [own for own in found if own.is_stable]
        if not stable:
            raise PlanningError(Obstacle.ONLY_UNSTABLE, f"{what}: indices {sorted({own.index for own in found})}")
        if self.is_exact:
            stable = [min(stable, key=self._distance)]
        within = [_within_limits(own) for own in stable]
        kept = [own for own in within if own is not None]
        if not kept:
            inputs = [np.round(own.inputs, 6).tolist() for own in stable]
            raise PlanningError(Obstacle.LIMITS, f"{what}: inputs {inputs}")
        greatest = max(own.singularity_margin for own in kept)
        if greatest < least_margin:
            raise PlanningError(Obstacle.GOAL_MARGIN, f"{what}: {greatest:.3g}, least_margin {least_margin:.3g}")
        kept = [own for own in kept if own.singularity_margin >= least_margin]
        sound = [own for own in kept if not structure.broken_by(own)]
        if not sound:
            broken = sorted({name for own in kept for name in structure.broken_by(own)})
            raise PlanningError(Obstacle.STRUCTURE, f"{what}: {', '.join(broken)}")
        return sound

    def _all(self, mechanism: Mechanism, load: Array) -> tuple[list[Equilibrium], str]:
        """Return all equilibria that meet the goal, and the goal in words."""
        if self.equilibrium is not None:
            return [self.equilibrium], f"inputs {np.round(self.equilibrium.inputs, 6).tolist()}"
        if self.inputs is not None:
            return list(solve_forward(mechanism, self.inputs, load)), f"inputs {self.inputs.tolist()}"
        assert self.pose is not None
        return list(solve_inverse(mechanism, self.pose, load)), f"pose {self.pose.tolist()}"


def wanted_of(goals: Sequence[Goal], count: int, mechanism: Mechanism) -> list[Wanted]:
    """Return what `count` goals ask for; raise if they are not so many."""
    refusal = f"goals must be as many as the starts, {count}, got {shown(goals)}"
    if isinstance(goals, str | bytes | Mapping) or not isinstance(goals, Iterable):
        raise TypeError(refusal)
    try:
        members = tuple(islice(goals, count + 1))
    except Exception:  # an array without an axis, or whatever a foreign object raises
        raise TypeError(refusal) from None
    if len(members) != count:
        raise ValueError(refusal)
    return [Wanted.of(goal, mechanism, f"goals[{place}]") for place, goal in enumerate(members)]


def carried_over(equilibrium: Equilibrium, mechanism: Mechanism, name: str) -> Equilibrium:
    """Return the stable equilibrium of another mechanism at the same inputs that is nearest in rod loads and pose.

    Raises
    ------
    ValueError
        If it has another number of legs or none there; `name` is that of the argument.
    """
    own = equilibrium.mechanism
    if (own.leg_count, own.dof) != (mechanism.leg_count, mechanism.dof):
        raise ValueError(f"{name} must be of a mechanism with legs like those of {mechanism.name!r}, got {equilibrium}")
    x = equilibrium.state.copy()
    x[2 * own.leg_count :] = mechanism.units.kernel_from_pose(equilibrium.pose)
    inputs, load = mechanism.units.kernel_from_inputs(equilibrium.inputs), equilibrium.load
    states = States(x[None], inputs[None], mechanism.units.kernel_from_load(load)[None])
    if settle(mechanism.leg_table, states)[0]:
        return Equilibrium.unchecked(mechanism, states.x[0], equilibrium.inputs, load)
    stable = solve_forward(mechanism, equilibrium.inputs, load).stable
    if not stable:
        raise ValueError(
            f"{name} must be where mechanism {mechanism.name!r} has a stable equilibrium too, got {equilibrium}"
        )
    return min(stable, key=lambda other: float(np.abs(other.state - equilibrium.state).max()))


def _within_limits(equilibrium: Equilibrium) -> Equilibrium | None:
    """Return an equilibrium with its motors turned to within their limits; None where that cannot be."""
    inputs = equilibrium.inputs_within_limits
    if inputs is None:
        return None
    return Equilibrium.unchecked(equilibrium.mechanism, equilibrium.state, inputs, equilibrium.load)
