"""A native Gymnasium batch as the vector environment that Stable-Baselines3 expects, and what learning adds to it."""

from collections.abc import Iterable, Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv, VectorWrapper
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper
from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices, VecEnvObs, VecEnvStepReturn

Info = dict[str, Any]

_FINAL_KEYS = frozenset({"final_obs", "_final_obs", "final_info", "_final_info"})


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
        observations, infos = reset(seed=seeds, options=self._options[0] or None)
        self.reset_infos = split_infos(infos, self.num_envs)
        self._reset_seeds()
        self._reset_options()
        return observations  # type: ignore[no-any-return]

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
        rows = _last_infos(infos, self.num_envs)
        finished = terminated | truncated
        for index in np.flatnonzero(finished):
            rows[index]["TimeLimit.truncated"] = bool(truncated[index] and not terminated[index])
        return observations, np.asarray(rewards, dtype=np.float32), finished, rows

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
        self._weight = weight

    def reset(self) -> VecEnvObs:
        """First observations of new episodes."""
        return self.venv.reset()

    def step_wait(self) -> VecEnvStepReturn:
        """Outcome of the step, its rewards less the weighted costs."""
        observations, rewards, dones, infos = self.venv.step_wait()
        costs = np.array([info["cost"] for info in infos], dtype=np.float32)
        return observations, rewards - self._weight * costs, dones, infos


def split_infos(infos: Info, count: int) -> list[Info]:
    """One dictionary per environment from a batch's arrays and their ``_key`` masks.

    Parameters
    ----------
    infos
        Arrays of length `count` (or nested dictionaries of them), each with the mask ``_key`` of the environments that
        have the entry; an array without a mask holds for all.
    count
        Number of environments.
    """
    rows: list[Info] = [{} for _ in range(count)]
    for key, column in infos.items():
        if not _is_mask(key, infos):
            _spread(rows, key, _values(column, count), infos.get(f"_{key}"))
    return rows


def _last_infos(infos: Info, count: int) -> list[Info]:
    """Infos of the step just taken: where the batch has already begun a new episode, those of the finished one."""
    rows = split_infos({key: column for key, column in infos.items() if key not in _FINAL_KEYS}, count)
    if "final_obs" in infos:
        final_rows = split_infos(infos["final_info"], count)
        for index in np.flatnonzero(infos["_final_obs"]):
            rows[index] = {**final_rows[index], "terminal_observation": infos["final_obs"][index]}
    return rows


def _is_mask(key: str, infos: Info) -> bool:
    return key.startswith("_") and key[1:] in infos


def _values(column: Any, count: int) -> Sequence[Any]:
    if isinstance(column, dict):
        return split_infos(column, count)
    return column.tolist() if column.ndim == 1 else list(column)


def _spread(rows: list[Info], key: str, values: Sequence[Any], mask: NDArray[np.bool_] | None) -> None:
    if mask is None or mask.all():
        for row, value in zip(rows, values, strict=True):
            row[key] = value
    else:
        for index in np.flatnonzero(mask):
            rows[index][key] = values[int(index)]
