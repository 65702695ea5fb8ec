"""Proof that one branch of equilibria leads along a path through equilibria, and that its Morse index stays."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pcm_gym.kernels.proofs.path_proof import (
    GOES_ON,
    PROVED,
    STOPPED,
    WRONG_INDEX,
    WRONG_STATE,
    new_proof,
    prove_pieces,
)
from pcm_gym.kernels.statics.states import States
from pcm_gym.mechanism import Mechanism
from pcm_gym.mechanism.validation import check_kinds, instance_of, sequence_of
from pcm_gym.solving.equilibrium import Equilibrium

# Pieces tried in a call of the kernel, which cannot be interrupted, and in all.
_PIECES_AT_ONCE, _MOST_PIECES = 500, 20_000

_REASONS = {GOES_ON: "limit", PROVED: "", STOPPED: "singular", WRONG_INDEX: "index", WRONG_STATE: "state"}
_MESSAGES = {
    "limit": "the search was broken off",
    "singular": "the branch folds or branches there, or all but does",
    "index": "the index seems to change, though no singular state was met",
    "state": "the branch does not come to the equilibrium that was given there",
}


@dataclass(frozen=True)
class PathCertificate:
    """What is proved of the branch along a path: straight lines in inputs and load between equilibria.

    If the path is proved, there is a curve of equilibria over the whole of it, one at each place, smooth, without a
    fold or a bifurcation; at each place it is the only one in a tube around it; the equilibria that were given are on
    it, up to `error`; and so its Morse index is the same everywhere. Otherwise that is proved up to a place, and
    `reason` says what is there.

    The proof is a computation with enclosures, and holds for all numbers that round to those given. The lines are cut
    into pieces. On each, Krawczyk's test with a parameter proves that there is exactly one equilibrium in a tube around
    a cubic curve, at every place; the equations and their derivatives come from Taylor models of the closed form of the
    rods. Where tubes meet, the equilibrium of one is proved to be inside of the other. The proof needs no directed
    rounding, and rests on the assumptions that `Certificate` names. That the index stays is proved; its number at the
    start is computed in double precision.

    Attributes
    ----------
    reason : str
        Why the proof ends; empty if all is proved. "singular": no tube could be proved beyond this place, at a fold or
        a bifurcation, or very near to one; "state": the equilibrium given at the end of this line (or at the start of
        the path) is not the one to which the branch comes, or is wrong by more than rounding errors; "index": the index
        computed at both ends differs, though it is proved not to change; "limit": the search was broken off.
    line : int
        Number of the line in which the proof ends, the first being 0; of the last one if all is proved.
    fraction : float
        Part of that line up to which the branch is proved, in [0, 1].
    index : int
        Morse index of the branch.
    error : float
        Bound of the errors of all given states as far as the proof goes: the largest difference of a component from
        that of the true equilibrium, relative to 1 + its size; inf if none is proved.
    tubes : int
        Number of pieces that were proved.
    """

    reason: str
    line: int
    fraction: float
    index: int
    error: float
    tubes: int

    def __post_init__(self) -> None:
        check_kinds(self, reason=str, line=int, fraction=float, index=int, error=float, tubes=int)

    @property
    def is_proved(self) -> bool:
        """Whether the whole path is proved."""
        return not self.reason

    @property
    def status(self) -> str:
        """Return "proved" or "undecided"."""
        return "proved" if self.is_proved else "undecided"

    def __repr__(self) -> str:
        """Return the status, and where and why the proof ends."""
        if self.is_proved:
            return f"PathCertificate: proved, index {self.index}, {self.tubes} tubes"
        place = f"line {self.line} at {self.fraction:.9g}"
        return f"PathCertificate: undecided, {self.reason} in {place}: {_MESSAGES[self.reason]}"


def certify_path(mechanism: Mechanism, equilibria: Sequence[Equilibrium]) -> PathCertificate:
    """Prove that one branch leads through equilibria, along the straight lines in inputs and load between them.

    Parameters
    ----------
    mechanism : Mechanism
        With any number of legs.
    equilibria : sequence of Equilibrium
        At least two, stable or not, each with its inputs and its load: where the path begins, turns and ends.

    Returns
    -------
    PathCertificate

    Raises
    ------
    TypeError, ValueError
        If the equilibria are fewer than two, are none, or belong to another mechanism.

    Notes
    -----
    The actuators' limits are no part of it. About 0.3 ms for a step of an agent with two legs, and 0.6 ms with three;
    more near folds. The first call compiles the proof, which takes some 30 s.
    """
    equilibria = _checked(mechanism, equilibria)
    values = [equilibrium.kernel_values() for equilibrium in equilibria]
    path = States(*(np.array(arrays) for arrays in zip(*values, strict=True)))
    proof = new_proof(path)
    for _ in range(_MOST_PIECES // _PIECES_AT_ONCE):
        standing = prove_pieces(mechanism.leg_table, path, proof, _PIECES_AT_ONCE)
        if standing != GOES_ON:
            break
    progress, fraction = proof.progress, float(proof.nodes[0].t[0])
    line, known = int(progress.line[0]), progress.errors[np.isfinite(progress.errors)]
    if line > 0 and fraction == 1.0:  # the end of a line is no start of the next
        line -= 1
    return PathCertificate(
        _REASONS[standing],
        line,
        fraction,
        int(progress.morse_index[0]),
        float(known.max()) if len(known) else math.inf,
        int(progress.tubes[0]),
    )


def _checked(mechanism: Mechanism, equilibria: Sequence[Equilibrium]) -> tuple[Equilibrium, ...]:
    instance_of("mechanism", mechanism, Mechanism)
    members: tuple[Equilibrium, ...] = sequence_of("equilibria", equilibria, Equilibrium)
    if len(members) < 2:
        raise ValueError(f"equilibria must be at least two, got {len(members)}")
    for n, equilibrium in enumerate(members):
        if equilibrium.mechanism != mechanism:
            raise ValueError(
                f"equilibria must belong to the mechanism {mechanism.name!r}, got one of "
                f"{equilibrium.mechanism.name!r} in place {n}"
            )
    return members
