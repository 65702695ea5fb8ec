"""A native Gymnasium batch as the vector environment that Stable-Baselines3 expects, and what learning adds to it."""

import time
from collections.abc import Iterable, Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv, VectorWrapper
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper
from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices, VecEnvObs, VecEnvStepReturn

from agents.learners.infos import Info, Infos, columns_of, last_infos


class NativeVecEnv(VecEnv):
    """Stable-Baselines3's `VecEnv` around one native batch that resets in the same step.

    At the end of an episode the observation is the next episode's first; the info is the finished episode's last, with
    ``terminal_observation`` (the observation the finished episode ended on) and ``TimeLimit.truncated`` (true only if
    time ran out and nothing else ended it: the learner then bootstraps). The batch is one object: attributes and
    methods are the batch's, repeated for each index, and reset options hold for all.

    Parameters
    ----------
    batch
        Made with ``autoreset_mode=AutoresetMode.SAME_STEP``. It hands out observations that it does not change later.

    Raises
    ------
    ValueError
        If the batch resets in another mode.
    """

    def __init__(self, batch: VectorEnv[Any, Any, Any]) -> None:
        mode = batch.metadata.get("autoreset_mode")
        if mode is None or AutoresetMode(mode) is not AutoresetMode.SAME_STEP:
            raise ValueError(f"the batch must reset in the same step (AutoresetMode.SAME_STEP), not {mode}")
        self.batch = batch
        self._actions: NDArray[Any] | None = None
        super().__init__(batch.num_envs, batch.single_observation_space, batch.single_action_space)

    def reset(self) -> VecEnvObs:
        """First observations of new episodes; the infos are left in `reset_infos`."""
        seeds = None if all(seed is None for seed in self._seeds) else list(self._seeds)
        reset: Any = self.batch.reset  # Gymnasium declares a single seed and takes a list as well
        observations: VecEnvObs
        observations, infos = reset(seed=seeds, options=self._options[0] or None)
        self.reset_infos = list(Infos(infos, self.num_envs))
        self._reset_seeds()
        self._reset_options()
        return observations

    def set_options(self, options: list[Info] | Info | None = None) -> None:
        """Keep options for the next reset; a batch takes one dictionary for all its environments."""
        if isinstance(options, list):
            raise TypeError("the batch takes one dictionary of options for all its environments, not a list")
        super().set_options(options)

    def step_async(self, actions: NDArray[Any]) -> None:
        """Keep the actions for `step_wait`."""
        self._actions = actions

    def step_wait(self) -> VecEnvStepReturn:
        """Step the batch with the actions kept by `step_async`."""
        observations, rewards, terminated, truncated, infos = self.batch.step(self._actions)
        lazy: Any = last_infos(infos, truncated, terminated)  # what passes for the list that is declared
        return observations, np.asarray(rewards, dtype=np.float32), terminated | truncated, lazy

    def close(self) -> None:
        """Close the batch."""
        self.batch.close()

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """The batch's attribute, once per index."""
        return [getattr(self._owner(attr_name), attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Set the batch's attribute, for all environments at once.

        Raises
        ------
        ValueError
            If `indices` names only some of the environments.
        """
        if len(set(self._get_indices(indices))) != self.num_envs:
            raise ValueError(f"{attr_name!r} belongs to the whole batch and cannot be set for some of it")
        setattr(self.batch.unwrapped, attr_name, value)

    def env_method(
        self, method_name: str, *method_args: Any, indices: VecEnvIndices = None, **method_kwargs: Any
    ) -> list[Any]:
        """Result of one call of the batch's method, once per index."""
        result = getattr(self._owner(method_name), method_name)(*method_args, **method_kwargs)
        return [result for _ in self._get_indices(indices)]

    def env_is_wrapped(
        self, wrapper_class: type[gymnasium.Wrapper] | type[VectorWrapper], indices: VecEnvIndices = None
    ) -> list[bool]:
        """Whether the batch is inside a wrapper of that class, once per index."""
        is_wrapped = any(isinstance(layer, wrapper_class) for layer in self._layers())
        return [is_wrapped for _ in self._get_indices(indices)]

    def get_images(self) -> Sequence[NDArray[np.uint8] | None]:
        """One picture of each environment, if the batch renders; else None for each."""
        frames: Any = self.batch.render() if self.render_mode == "rgb_array" else None
        return [None] * self.num_envs if frames is None else list(frames)

    def _owner(self, name: str) -> VectorEnv[Any, Any, Any]:
        return self.batch if hasattr(self.batch, name) else self.batch.unwrapped

    def _layers(self) -> Iterable[VectorEnv[Any, Any, Any]]:
        layer = self.batch
        while isinstance(layer, VectorWrapper):
            yield layer
            layer = layer.env
        yield layer


class EpisodeMonitor(VecEnvWrapper):
    """Puts ``episode`` (return, length and time) into the last info of each episode, and touches no other info.

    `VecMonitor` does the same and makes every info a dictionary for it.
    """

    def __init__(self, venv: VecEnv) -> None:
        super().__init__(venv)
        self._start = time.time()

    def reset(self) -> VecEnvObs:
        """First observations of new episodes."""
        self._returns = np.zeros(self.num_envs)
        self._lengths = np.zeros(self.num_envs, dtype=np.int64)
        return self.venv.reset()

    def step_wait(self) -> VecEnvStepReturn:
        """Outcome of the step, the episodes that have ended summed up in their infos."""
        observations, rewards, dones, infos = self.venv.step_wait()
        self._returns += rewards
        self._lengths += 1
        now = round(time.time() - self._start, 6)
        for row in np.flatnonzero(dones).tolist():
            infos[row]["episode"] = {"r": float(self._returns[row]), "l": int(self._lengths[row]), "t": now}
        self._returns[dones], self._lengths[dones] = 0.0, 0
        return observations, rewards, dones, infos


class CostPenalty(VecEnvWrapper):
    """Takes a multiple of each step's cost from its reward; what the infos say stays as it is.

    Parameters
    ----------
    venv
        Environments whose infos have a `cost`.
    weight
        Reward that a cost of one takes away.
    """

    def __init__(self, venv: VecEnv, weight: float) -> None:
        super().__init__(venv)
        self.weight = weight

    def reset(self) -> VecEnvObs:
        """First observations of new episodes."""
        return self.venv.reset()

    def step_wait(self) -> VecEnvStepReturn:
        """Outcome of the step, its rewards less the weighted costs."""
        observations, rewards, dones, infos = self.venv.step_wait()
        costs: NDArray[np.float32] = columns_of(infos)["cost"].astype(np.float32)
        return observations, rewards - np.float32(self.weight) * costs, dones, infos
