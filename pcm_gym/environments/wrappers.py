"""Wrappers: the cost as an element of the step, and shields that ask what an action would do before it is done."""

from typing import Any

import gymnasium
import numpy as np
from gymnasium.utils import RecordConstructorArgs
from gymnasium.vector import AutoresetMode, VectorActionWrapper, VectorEnv, VectorWrapper
from gymnasium.wrappers.vector import DictInfoToList
from numpy.typing import NDArray

from pcm_gym.arrays import Mask
from pcm_gym.environments.batch import MechanismVectorEnv
from pcm_gym.environments.shield import Shield
from pcm_gym.environments.single import MechanismEnv, Observation
from pcm_gym.mechanism.validation import instance_of, positive_number

Action = NDArray[np.float32]

_THE_ONE = np.zeros(1, dtype=np.int64)  # the row of a single environment


class CostStep(gymnasium.Wrapper[Observation, Action, Observation, Action], RecordConstructorArgs):
    """Returns the cost beside the reward, as Safety-Gymnasium does: six values per step.

    ``observation, reward, cost, terminated, truncated, info = env.step(action)``. For libraries of safe reinforcement
    learning that expect it; what they hand on to must not be a wrapper or checker of Gymnasium's five values.

    Parameters
    ----------
    env : gymnasium.Env
        An environment whose infos have a `cost`.
    """

    def __init__(self, env: gymnasium.Env[Observation, Action]) -> None:
        RecordConstructorArgs.__init__(self)
        super().__init__(instance_of("env", env, gymnasium.Env))

    def step(  # type: ignore[override]  # six values instead of five are its purpose
        self, action: Action
    ) -> tuple[Observation, float, float, bool, bool, dict[str, Any]]:
        """Step, with ``info["cost"]`` as the third value."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        return observation, float(reward), float(info["cost"]), terminated, truncated, info


class SolverShield(gymnasium.Wrapper[Observation, Action, Observation, Action], RecordConstructorArgs):
    """Asks what an action would do before it is done, and replaces one that is not safe by a safe one near it.

    An action is safe if its step arrives on the branch, stable and with a singularity margin of at least
    `least_margin`, and if the same holds for every step of stopping after it. Stopping matters where the clamps follow
    late: they go on after a harmless step, and no later action may keep them from passing a fold. To stop is to bring
    the commands back to where the drives are, as fast as actions may, until all is at rest.

    Of a fixed set of candidates around the action and of stopping, the nearest safe one is taken and moved towards the
    action as far as it is safe. If none is safe, that with the largest least margin on its way is taken; if all ways
    lose stability, that which does so last. ``info["shielded"]`` says whether the action was replaced.

    Parameters
    ----------
    env : gymnasium.Env
        An environment of this package, wrapped or not, but for wrappers that change actions: those go around this one.
    least_margin : float, optional
        The threshold of `cost_singular` of the environment by default.

    Raises
    ------
    TypeError, ValueError
        If `env` is another environment, or its actions are changed on the way; if `least_margin` is not positive.

    Notes
    -----
    From a state in which stopping is safe, at rest for one, there is always a safe action: to stop, because the rest of
    a safe way is a safe way. So no sequence of actions leads to a loss of stability or below the margin, with any lag,
    rate limit, backlash, load or variant of the mechanism, whatever `on_instability` is; episodes begin at rest. From a
    stable state with a smaller margin, in which stopping keeps stability, it is not lost either, and the least margin
    on the way does not fall. This rests on previews being what steps do, to the last bit, and on the solver's verdicts
    along each step. It holds up to 1e-7 of the largest increment, by which the drives may creep on at rest. Nothing is
    promised from other states: unstable ones, or those that an environment got into without its shield.

    The shield has no memory. A safe action costs its preview, and those of stopping where the clamps follow late; one
    that is not safe costs 150 to 300 in a few calls, about a millisecond.
    """

    def __init__(self, env: gymnasium.Env[Observation, Action], least_margin: float | None = None) -> None:
        own = instance_of("env", env, gymnasium.Env).unwrapped
        if not isinstance(own, MechanismEnv):
            raise TypeError(f"env must be an environment of pcm_gym, got {own!r}")
        self.least_margin = _margin(own.singular_margin, least_margin)
        RecordConstructorArgs.__init__(self, least_margin=self.least_margin)
        super().__init__(env)
        _refuse(env, gymnasium.ActionWrapper, "change actions")
        self._mechanism_env = own
        self._shield = Shield(own._simulation, self.least_margin)

    def step(self, action: Action) -> tuple[Observation, Any, bool, bool, dict[str, Any]]:
        """Step with the action, or with the safe one that replaces it."""
        chosen, is_replaced = self._shield.choose(_THE_ONE, self._mechanism_env._checked(action))
        if is_replaced[0]:
            action = chosen[0].astype(np.float32)
        observation, reward, terminated, truncated, info = self.env.step(action)
        return observation, reward, terminated, truncated, {**info, "shielded": bool(is_replaced[0])}


class VectorSolverShield(VectorWrapper[Observation, Action, Observation, Action]):
    """`SolverShield` for the native batch: row by row and bit for bit the same, decided for all rows at once.

    ``infos["shielded"]``, with its mask, says whose actions were replaced. An environment that begins a new episode in
    a step has its action ignored, as without a shield; in the mode "SameStep" what is said of the last step of an
    episode is in `final_info`.

    Parameters
    ----------
    env : gymnasium.vector.VectorEnv
        A native batch of this package, wrapped or not, but for wrappers that change actions or make lists of infos:
        those go around this one.
    least_margin : float, optional
        The threshold of `cost_singular` of the environments by default.

    Raises
    ------
    TypeError, ValueError
        As for `SolverShield`.
    """

    def __init__(self, env: VectorEnv[Observation, Action, Any], least_margin: float | None = None) -> None:
        super().__init__(instance_of("env", env, VectorEnv))
        if not isinstance(env.unwrapped, MechanismVectorEnv):
            raise TypeError(f"env must be a native batch of pcm_gym, got {env.unwrapped!r}")
        _refuse(env, VectorActionWrapper, "change actions")
        _refuse(env, DictInfoToList, "make lists of infos")
        self._batch = env.unwrapped
        self.least_margin = _margin(env.unwrapped._simulation.settings.singular_margin, least_margin)
        self._shield = Shield(env.unwrapped._simulation, self.least_margin)

    def step(self, actions: Action) -> tuple[Observation, NDArray[np.float64], Mask, Mask, dict[str, Any]]:
        """Step every environment with its action, or with the safe one that replaces it."""
        values: Any = self._batch._checked_actions(actions)
        is_begun = self._batch._ended & (self._batch.autoreset_mode is AutoresetMode.NEXT_STEP)
        rows, is_replaced = np.flatnonzero(~is_begun), np.zeros(len(values), dtype=np.bool_)
        chosen, is_replaced[rows] = self._shield.choose(rows, values[rows])
        if is_replaced.any():
            values[rows] = chosen
            actions = values
        observation, reward, terminated, truncated, infos = self.env.step(actions)
        _add_shielded(infos, is_replaced, ~is_begun)
        return observation, reward, terminated, truncated, infos


def _add_shielded(infos: dict[str, Any], is_replaced: Mask, has_stepped: Mask) -> None:
    """Add to the infos of a batch whose actions were replaced; the last of an episode belong to its final infos."""
    if "final_info" in infos:
        has_ended = infos["_final_info"]
        infos["final_info"].update(shielded=is_replaced & has_ended, _shielded=has_ended.copy())
        has_stepped = has_stepped & ~has_ended
    infos.update(shielded=is_replaced & has_stepped, _shielded=has_stepped)


def _refuse(env: Any, kind: type, what: str) -> None:
    """Raise if there is a wrapper of a kind that does what the shield cannot stand on: actions asked about, infos."""
    while env is not env.unwrapped:
        if isinstance(env, kind):
            raise ValueError(f"env must not {what}, put {env.__class__.__name__} around the shield; got {env}")
        env = env.env


def _margin(singular_margin: float, least_margin: float | None) -> float:
    return singular_margin if least_margin is None else positive_number("least_margin", least_margin)
