"""A reference as a policy: from observations to actions, for one environment or for a native batch."""

from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import VectorEnv
from numpy.typing import NDArray

from pcm_gym.mechanism.validation import whole_number
from pcm_gym.references.table import new_reference
from pcm_gym.references.view import View

Environment = gymnasium.Env[Any, Any] | VectorEnv[Any, Any, Any]


class ReferencePolicy:
    """Acts in one environment, or in one native batch, as a reference of the table does.

    ``policy(observation)`` returns an action (actuators,), or those of the batch, (n, actuators), for what a reset or
    step of that environment has just returned: references know more than that, so each policy belongs to its
    environment.

    Parameters
    ----------
    name : str
        A name in `REFERENCES`.
    env : gymnasium.Env or gymnasium.vector.VectorEnv
        An environment of this package, wrapped or not.
    seed : int
        Of the policy's own chance.

    Raises
    ------
    TypeError, ValueError
        If there is no such reference, or it is another environment.
    """

    def __init__(self, name: str, env: Environment, seed: int = 0) -> None:
        self._controller, self._env = new_reference(name), env
        count = env.num_envs if isinstance(env, VectorEnv) else 1
        self._is_single = not isinstance(env, VectorEnv)
        first = whole_number("seed", seed, least=0, most=None)
        self._generators = [np.random.default_rng([first, row]) for row in range(count)]
        View.of(env, {}, self._generators)

    def __call__(self, observation: dict[str, NDArray[Any]]) -> NDArray[np.float32]:
        """Return what to do next."""
        actions = self._controller.act(View.of(self._env, observation, self._generators)).astype(np.float32)
        return actions[0] if self._is_single else actions
