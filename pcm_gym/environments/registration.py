"""The table of environments, and their registration with Gymnasium."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np
from gymnasium.envs.registration import EnvSpec

if TYPE_CHECKING:
    from pcm_gym.mechanism import Mechanism
    from pcm_gym.tasks import Task

# Of single environments, by which they are known to be of this package.
ENTRY_POINT = "pcm_gym.environments.single:MechanismEnv"


@dataclass(frozen=True)
class Registered:
    """An environment by its id: a mechanism and a task by their names, and what arguments differ from the defaults."""

    id: str
    mechanism: str
    task: str
    time_limit: int | None
    arguments: Mapping[str, Any] = field(default_factory=dict)

    def register(self) -> None:
        """Make it known to Gymnasium, by names so that its specification has a JSON; a second call changes nothing.

        Raises
        ------
        ValueError
            If the id is that of something else.
        """
        entry: dict[str, Any] = {
            "entry_point": ENTRY_POINT,
            "vector_entry_point": "pcm_gym.environments.batch:MechanismVectorEnv",
            "max_episode_steps": self.time_limit,
            "kwargs": {"mechanism": self.mechanism, "task": self.task, **self.arguments},
        }
        known = gymnasium.registry.get(self.id)
        if known is None:
            try:
                gymnasium.register(self.id, **entry)
            except gymnasium.error.Error as error:
                raise ValueError(
                    f"environment_id must be such as 'Namespace/Name-v0', got {self.id!r}: {error}"
                ) from error
        elif known != EnvSpec(self.id, **entry):
            raise ValueError(f"environment_id must be a new one, got {self.id!r}: it is registered as something else")


ENVIRONMENTS = (
    Registered("PCM/2RFR-Reach-v0", "2RFR", "Reach", 100),
    Registered("PCM/2PFR-Reach-v0", "2PFR", "Reach", 100),
    Registered("PCM/3PFR-Reach-v0", "3PFR", "Reach", 100),
    Registered("PCM/2RFR-Track-v0", "2RFR", "Track", 200),
    Registered("PCM/2PFR-Track-v0", "2PFR", "Track", 200),
    Registered("PCM/3PFR-Track-v0", "3PFR", "Track", 200),
    Registered("PCM/2RFR-Switch-v0", "2RFR", "Switch", 150),
    Registered("PCM/2PFR-Switch-v0", "2PFR", "Switch", 150),
    Registered("PCM/3PFR-Switch-v0", "3PFR", "Switch", 150),
)


def environment_ids() -> list[str]:
    """Return the ids of all environments of this package."""
    return [own.id for own in ENVIRONMENTS]


def register_environments() -> None:
    """Register every environment of the table; a second call changes nothing."""
    for own in ENVIRONMENTS:
        own.register()


def register_environment(
    environment_id: str,
    *,
    mechanism: "Mechanism | str",
    task: "type[Task] | str" = "Reach",
    time_limit: int | None = None,
    **arguments: Any,
) -> None:
    """Register an environment of one's own, after which ``gymnasium.make(environment_id)`` makes it.

    Parameters
    ----------
    environment_id : str
        "Namespace/Name-v0", a new one.
    mechanism : Mechanism or str
        A mechanism, which is then in the catalogue, or the name of one that is.
    task : class of tasks or str
        A class of tasks, which is then in the table, or the name of one that is.
    time_limit : int, optional
        Steps after which an episode is truncated; never by default.
    **arguments
        Any of `EnvironmentArguments`, and the task's own, where they differ from the defaults. Arrays are kept as
        lists; only what JSON can hold lets the environment's specification be written as such.

    Raises
    ------
    TypeError
        If there is no such argument.
    ValueError
        If the id, or the name of the mechanism or of the task, is that of another one; if there is none of that name.
    """
    # imported here, with all of the mechanics, which registering by name does without
    from pcm_gym.environments.arguments import task_arguments
    from pcm_gym.mechanism import get_mechanism, mechanism_names, register_mechanism
    from pcm_gym.mechanism.catalogue import free_name
    from pcm_gym.mechanism.validation import one_of, text, whole_number
    from pcm_gym.tasks import free_task_name, register_task, task_type

    text("environment_id", environment_id)
    task_arguments(task_type(task), arguments)
    arguments = {name: own.tolist() if isinstance(own, np.ndarray) else own for name, own in arguments.items()}
    if time_limit is not None:
        time_limit = whole_number("time_limit", time_limit, least=1)
    own = get_mechanism(one_of("mechanism", mechanism, mechanism_names())) if isinstance(mechanism, str) else mechanism
    task_name = task if isinstance(task, str) else free_task_name(task)
    Registered(environment_id, free_name(own), task_name, time_limit, arguments).register()
    # the names are free, and all is known or nothing
    register_mechanism(own)
    if not isinstance(task, str):
        register_task(task)
