"""Following a branch of equilibria as the inputs and the load change."""

from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np
from numpy.typing import ArrayLike

from pcm_gym.kernels.branches import continuation
from pcm_gym.kernels.statics.states import Point
from pcm_gym.mechanism import Mechanism
from pcm_gym.mechanism.validation import check_kinds, instance_of, truth_value
from pcm_gym.solving.equilibrium import Equilibrium
from pcm_gym.solving.path_certification import PathCertificate, certify_path


class Event(IntEnum):
    """Why a step along a branch, or of an environment, ended where it did.

    A whole number, as infos tell it, with a name: ``Event(info["event"])`` is ``Event.FOLD``, whose text is "fold".
    """

    NONE = continuation.NONE
    FOLD = continuation.FOLD
    INDEX_CHANGE = continuation.INDEX_CHANGE
    ACTUATOR_LIMIT = continuation.ACTUATOR_LIMIT
    SOLVER_FAILURE = continuation.SOLVER_FAILURE

    def __str__(self) -> str:
        """Return the name in small letters, such as "index_change"."""
        return self.name.lower()

    def __format__(self, spec: str) -> str:
        """Return the same in formatted text, whichever version of Python."""
        return format(str(self), spec)

    @property
    def message(self) -> str:
        """What the event means, in a sentence."""
        return _MESSAGES[self]


_MESSAGES = {
    Event.NONE: "The target was reached.",
    Event.FOLD: "The branch folds back: no equilibrium continues it, the mechanism would snap.",
    Event.INDEX_CHANGE: "The branch goes on with another number of unstable directions (a bifurcation).",
    Event.ACTUATOR_LIMIT: "An actuator met its limit.",
    Event.SOLVER_FAILURE: "The solver could not follow the branch; this says nothing about the mechanism.",
}


@dataclass(frozen=True)
class TrackedStep:
    """Result of one step along a branch.

    Attributes
    ----------
    equilibrium : Equilibrium
        The target's equilibrium, or the last one before the event; from a fold, `snap` tells where it falls.
    event : Event
        Why the step ended; `Event.NONE` if the target was reached.
    fraction : float
        Part of the way that was gone, in [0, 1]; at a fold exact to 1e-8.
    certificate : PathCertificate or None
        What is proved of the way that was gone, if that was asked for; its `fraction` is one of the whole way.
    """

    equilibrium: Equilibrium
    event: Event
    fraction: float
    certificate: PathCertificate | None = None

    def __post_init__(self) -> None:
        check_kinds(
            self, equilibrium=Equilibrium, event=Event, fraction=float, certificate=PathCertificate | type(None)
        )


class BranchTracker:
    """Follows the branch of an equilibrium along straight lines in inputs and load.

    Parameters
    ----------
    mechanism : Mechanism
    equilibrium : Equilibrium
        Where to start; an equilibrium of this mechanism.
    follow_index_changes : bool
        Whether to go on through bifurcations, where the branch continues with another index. A fold always stops.
    certify : bool
        Whether to prove of each step that one branch, of one index, leads from its start to its end (see
        `certify_path`). A step that ends at a fold or a change of index is proved up to just before it.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        equilibrium: Equilibrium,
        *,
        follow_index_changes: bool = False,
        certify: bool = False,
    ) -> None:
        instance_of("mechanism", mechanism, Mechanism)
        if instance_of("equilibrium", equilibrium, Equilibrium).mechanism != mechanism:
            raise ValueError(
                f"equilibrium must belong to the mechanism {mechanism.name!r}, "
                f"got one of {equilibrium.mechanism.name!r}"
            )
        self._mechanism = mechanism
        self._equilibrium = equilibrium
        self._follow_index_changes = truth_value("follow_index_changes", follow_index_changes)
        self._certify = truth_value("certify", certify)

    @property
    def equilibrium(self) -> Equilibrium:
        """The present equilibrium."""
        return self._equilibrium

    def step(self, inputs: ArrayLike, load: ArrayLike | None = None) -> TrackedStep:
        """Follow the branch to these inputs and load, and stay where that ends.

        Parameters
        ----------
        inputs : array_like (legs,)
            Target inputs, rad or m.
        load : array_like (d,), optional
            Target load, N and N m; the present load by default.

        Returns
        -------
        TrackedStep

        Raises
        ------
        ValueError
            If an argument has the wrong shape or is not finite.
        """
        mechanism, units, start = self._mechanism, self._mechanism.units, self._equilibrium
        inputs_wanted = mechanism.check_inputs(inputs)
        load_wanted = np.array(start.load) if load is None else mechanism.check_load(load)
        point = Point(*start.kernel_values())
        event, fraction = continuation.follow_branch(
            mechanism.leg_table,
            point,
            units.kernel_from_inputs(inputs_wanted),
            units.kernel_from_load(load_wanted),
            self._follow_index_changes,
        )
        if fraction < 1.0:
            inputs_wanted, load_wanted = units.inputs_from_kernel(point.inputs), units.load_from_kernel(point.load)
        self._equilibrium = Equilibrium.unchecked(mechanism, point.x, inputs_wanted, load_wanted)
        certificate = None
        if self._certify:
            certificate = certify_path(mechanism, [start, self._equilibrium])
            certificate = replace(certificate, fraction=certificate.fraction * fraction)
        return TrackedStep(self._equilibrium, Event(event), fraction, certificate)
