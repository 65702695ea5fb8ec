"""The policies that come with the package."""

import os
from pathlib import Path
from typing import NamedTuple

from pcm_gym.mechanism.validation import one_of, text
from pcm_gym.policies.files import PolicyError
from pcm_gym.policies.policy import Policy

FOLDER = Path(__file__).parent / "shipped"
ENDING = ".npz"

# What a policy of several for one task is the first in: safe success, losses of stability, size.
KINDS = ("best", "safest", "smallest")
_DEFAULT_DIFFICULTY = "default"


class PolicyKey(NamedTuple):
    """What a shipped policy is named by.

    Attributes
    ----------
    environment_id : str
    difficulty : str, optional
        None for the environment's default.
    kind : "best", "safest" or "smallest"
    """

    environment_id: str
    difficulty: str | None = None
    kind: str = KINDS[0]

    @property
    def file_name(self) -> str:
        """Name of its file: ``PCM--2RFR-Reach-v0.anywhere.best.npz``."""
        environment = self.environment_id.replace("/", "--")
        return f"{environment}.{self.difficulty or _DEFAULT_DIFFICULTY}.{self.kind}{ENDING}"

    @classmethod
    def of_file(cls, path: Path) -> "PolicyKey":
        """Return the key that a file's name stands for."""
        environment, difficulty, kind = path.name.removesuffix(ENDING).split(".")
        return cls(environment.replace("--", "/"), None if difficulty == _DEFAULT_DIFFICULTY else difficulty, kind)


def shipped_policies() -> list[PolicyKey]:
    """Return the keys of all policies that come with the package: ``load_policy(*key)``."""
    return [PolicyKey.of_file(path) for path in sorted(FOLDER.glob(f"*{ENDING}"))]


def load_policy(source: str | os.PathLike[str], difficulty: str | None = None, kind: str = KINDS[0]) -> Policy:
    """Return a policy, shipped with the package or from a file. It needs NumPy only, and runs no code of a file.

    Parameters
    ----------
    source : str or path
        Id of an environment, as "PCM/2RFR-Reach-v0", or a file with the ending ".npz" that `Policy.save` or
        ``python -m agents.export`` has written.
    difficulty : str, optional
        For an id: the difficulty that the environment is made with; None for its default.
    kind : "best", "safest" or "smallest"
        For an id: the policy with the most safe successes, with the fewest losses of stability, or with the fewest
        numbers.

    Raises
    ------
    PolicyError
        If there is no such policy, the message lists those there are; if a file is none or damaged.
    TypeError, ValueError
        If an argument cannot be what it is for.

    Examples
    --------
    ::

        policy = pcm_gym.load_policy("PCM/2RFR-Reach-v0")
        observation, info = env.reset()
        action = policy(observation)
    """
    if difficulty is not None:
        text("difficulty", difficulty)
    one_of("kind", kind, KINDS)
    if isinstance(source, os.PathLike) or text("source", source).endswith(ENDING):
        return Policy.load(source)
    key = PolicyKey(source, difficulty, kind)
    known = shipped_policies()
    if key not in known:
        listed = ", ".join(f"{own.environment_id} ({own.difficulty or 'default'}, {own.kind})" for own in known)
        wanted = f"{key.environment_id!r}, difficulty {difficulty!r}, kind {kind!r}"
        raise PolicyError(f"no policy for {wanted} comes with the package; there are: {listed or 'none yet'}")
    return Policy.load(FOLDER / key.file_name)
