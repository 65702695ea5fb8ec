"""Rollouts of the environments as scenarios: each id, each behaviour, each kind of realism, each argument of a task."""

from dataclasses import dataclass, field, replace
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

import pcm_gym
from tests.environments.rollouts import (
    make_bare,
    make_native,
    roll_single,
    sweeping_actions,
)
from tests.golden.given_starts import STARTS
from tests.golden.records import LOSSES, SOUND_MARGIN, Record
from tests.reference.mechanisms import FAMILIES

# In names of scenarios that chance of rounding decides: only for digests.
SYMMETRIC = "symmetric"
BEHAVIOURS = ("terminate", "snap", "hold", "continue")
SINGLE_STEPS, BATCH_STEPS = 240, 60
# More than one block of lanes.
BATCH_ROWS = 70
EXACT: tuple[str, ...] = ("is_reset", "terminated", "truncated", "is_success", "index", "event")
EXACT += ("at_limit", "cost", "cost_unstable", "cost_singular", "cost_solver")
CLOSE = ("observation", "achieved_goal", "desired_goal", "reward", "stability_margin", "singularity_margin")

LOADS: dict[str, tuple[tuple[float, ...], tuple[float, ...]]] = {
    "2RFR": ((-0.1, -0.4), (0.3, 0.1)),
    "2PFR": ((1.6, -1.2), (2.4, -0.8)),
    "3PFR": ((-0.1, -0.2, -0.02), (0.1, 0.1, 0.02)),
}
# Symmetric mechanisms have pairs to switch between whose order is a matter of rounding: not under these loads.
SWITCH_LOADS = {"2RFR": (0.05, -0.1), "3PFR": (0.05, -0.1, 0.01)}
PARTS = {"stiffness": 0.2, "length": 0.05, "base": 0.02}
RATES, PLAYS = {"2RFR": 0.05, "2PFR": 0.012, "3PFR": 0.012}, {"2RFR": 0.02, "2PFR": 0.006, "3PFR": 0.006}


@dataclass(frozen=True)
class Rollout:
    """A rollout of one environment, or of a batch of them; `start` says from where, by default what is drawn."""

    environment_id: str
    keywords: dict[str, Any] = field(default_factory=dict)
    is_batch: bool = False
    start: str = "drawn"
    seed: int = 5

    def run(self) -> Record:
        if self.start != "drawn":
            return _record(STARTS[self.start](self.environment_id, self.keywords))
        if self.is_batch:
            env = make_native(self.environment_id, BATCH_ROWS, **{"max_episode_steps": 25, **self.keywords})
            return _record(_roll_batch(env, self.seed))
        env = make_bare(self.environment_id, **self.keywords)
        record = _record(roll_single(env, self.seed, SINGLE_STEPS))
        ends = [env.equilibrium, env.witness]
        last = {"last_states": np.array([end.state for end in ends]), "last_inputs": np.array([e.inputs for e in ends])}
        return replace(record, rough=record.rough | last)


def _roll_batch(env: Any, seed: int) -> list[Any]:
    """Everything that reset and step return; where it is up to the caller, a reset follows the end of an episode."""
    records: list[Any] = [env.reset(seed=seed)]
    for action in sweeping_actions(BATCH_STEPS, env.action_space.shape, seed):
        records.append(env.step(action))
        ended = records[-1][2] | records[-1][3]
        if env.autoreset_mode is AutoresetMode.DISABLED and ended.any():
            records.append(env.reset(options={"reset_mask": ended}))
    return records


def _record(results: list[Any]) -> Record:
    """All that was returned, field by field; where there are several environments, one after the other in each step."""
    rows = [_fields(result) for result in results]
    names = sorted(set().union(*rows))
    # what ended episodes leave behind comes only in some steps
    arrays = {name: np.stack([row[name] if name in row else _blank(rows, name) for row in rows]) for name in names}
    count = arrays["terminated"][0].size
    if arrays["terminated"].ndim == 2:
        arrays = {name: array.reshape(-1, *array.shape[2:]) for name, array in arrays.items()}
    exact = {name: arrays.pop(name) for name in names if name.removeprefix("final_") in EXACT}
    close = {name: arrays.pop(name) for name in CLOSE}
    # a step that meets a fold and goes on ends with a looser tolerance: what it comes to is seen a step later
    is_lost = np.isin(exact["event"], LOSSES)
    is_sound = ~is_lost & (close["singularity_margin"] > SOUND_MARGIN)
    later = np.flatnonzero(is_lost) + count
    return Record(exact, close, is_sound, arrays, telling=later[later < len(is_sound)])


def _fields(result: Any) -> dict[str, NDArray[Any]]:
    """One result of reset or step as arrays by name; masks of infos are left out."""
    observation, info, is_step = result[0], dict(result[-1]), len(result) == 5
    shape = np.shape(info["cost"])
    reward, terminated, truncated = result[1:4] if is_step else (np.zeros(shape), *np.zeros((2, *shape), dtype=bool))
    fields = {**observation, "reward": reward, "terminated": terminated, "truncated": truncated}
    fields["is_reset"] = np.full(shape, not is_step)
    if "final_obs" in info:
        fields |= _final(info.pop("final_obs"), info.pop("final_info"))
    fields |= {name: value for name, value in info.items() if not name.startswith("_")}
    return {name: np.asarray(value) for name, value in fields.items()}


def _final(observations: Any, info: dict[str, Any]) -> dict[str, NDArray[Any]]:
    """The last observations and infos of the episodes that have ended; nothing, as zeros, in the other rows."""
    example = next(own for own in observations if own is not None)
    blank = {name: np.zeros_like(value) for name, value in example.items()}
    found = {
        f"final_{name}": np.stack([(blank if own is None else own)[name] for own in observations]) for name in example
    }
    return found | {f"final_{name}": value for name, value in info.items() if not name.startswith("_")}


def _blank(rows: list[dict[str, NDArray[Any]]], name: str) -> NDArray[Any]:
    return np.zeros_like(next(row[name] for row in rows if name in row))


# The table


def _behaviours() -> dict[str, tuple[str, dict[str, Any]]]:
    """Every id with every behaviour that it allows, with a load under which it folds."""
    table = {}
    for environment_id in pcm_gym.environment_ids():
        can_only_fall = gymnasium.spec(environment_id).kwargs.get("difficulty") == "fall"
        for behaviour in ("snap",) if can_only_fall else BEHAVIOURS:
            keywords = {"on_instability": behaviour, **_load(environment_id)}
            table[f"{_short(environment_id)}-{behaviour}"] = environment_id, keywords
    return table


def _realism() -> dict[str, tuple[str, dict[str, Any]]]:
    """Every kind of realism on every mechanism, by itself in Reach and combined in the other tasks."""
    table = {}
    for name in FAMILIES:
        parts = PARTS | ({"attachment": 0.01} if name == "3PFR" else {})
        kinds: dict[str, dict[str, Any]] = {
            "load": {"load": LOADS[name], "variants": 2},
            "parts": {"randomisation": parts, "variants": 2},
            "lag": {"actuator_lag": 1.5},
            "rate": {"rate_limit": RATES[name]},
            "backlash": {"backlash": PLAYS[name]},
            "noise": {"observation_noise": 0.02},
        }
        for kind, keywords in kinds.items():
            table[f"{name}-Reach-{kind}"] = f"PCM/{name}-Reach-v0", keywords
        table[f"{name}-Reach-lag-hold"] = f"PCM/{name}-Reach-v0", {**kinds["lag"], "on_instability": "hold"}
        varied = {**kinds["parts"], **kinds["load"], "observe_load": False, "on_instability": "snap"}
        table[f"{name}-Track-load-parts-snap"] = f"PCM/{name}-Track-v0", varied
        moved = {**kinds["lag"], **kinds["backlash"], **kinds["rate"], **kinds["noise"]}
        table[f"{name}-Track-actuators-noise"] = f"PCM/{name}-Track-v0", moved
    return table


def _tasks() -> dict[str, tuple[str, dict[str, Any]]]:
    """What the arguments of the tasks change."""
    generous = {"success_distance": 0.2, "hold_steps": 2, "reward_type": "sparse"}
    steps = {"max_action": (0.05, 0.12), "singular_margin": 0.1}
    table: dict[str, tuple[str, dict[str, Any]]] = {
        "2RFR-Reach-anywhere": ("PCM/2RFR-Reach-v0", {"difficulty": "anywhere"}),
        "3PFR-Reach-anywhere": ("PCM/3PFR-Reach-v0", {"difficulty": "anywhere"}),
        "2RFR-Reach-detour": ("PCM/2RFR-Reach-v0", {"difficulty": "detour"}),
        "2RFR-Reach-sparse": ("PCM/2RFR-Reach-v0", generous),
        "3PFR-Reach-generous": ("PCM/3PFR-Reach-v0", {**generous, "reward_type": "dense"}),
        "2RFR-Reach-steps": ("PCM/2RFR-Reach-v0", steps),
        "2PFR-Track-sparse": ("PCM/2PFR-Track-v0", {**generous, "success_distance": 0.05}),
        "2RFR-Switch-sparse": ("PCM/2RFR-Switch-v0", {**generous, **_load("PCM/2RFR-Switch-v0")}),
    }
    falling = {"difficulty": "fall", "on_instability": "snap"}
    table["2RFR-Switch-fall"] = "PCM/2RFR-Switch-v0", {**falling, **_load("PCM/2RFR-Switch-v0")}
    for environment_id in ("PCM/2RFR-Switch-v0", "PCM/3PFR-Switch-v0"):
        table[f"{_short(environment_id)}-{SYMMETRIC}"] = environment_id, {}
    for path in ("circle", "eight", "spline"):
        table[f"2RFR-Track-{path}"] = "PCM/2RFR-Track-v0", {"path": path}
        table[f"3PFR-Track-{path}"] = "PCM/3PFR-Track-v0", {"path": path}
    return table


def _load(environment_id: str) -> dict[str, Any]:
    """A load under which the mechanism is no more symmetric, where that matters."""
    name = environment_id.removeprefix("PCM/").split("-")[0]
    if "-Switch-" in environment_id and name in SWITCH_LOADS:
        return {"load": SWITCH_LOADS[name]}
    return {}


def _short(environment_id: str) -> str:
    return environment_id.removeprefix("PCM/").removesuffix("-v0")


def _given(mechanism: str, start: str, behaviour: str) -> Rollout:
    return Rollout(f"PCM/{mechanism}-Reach-v0", {"on_instability": behaviour}, start=start)


def _scenarios() -> dict[str, Rollout]:
    scenarios = {}
    for name, (environment_id, keywords) in (_behaviours() | _realism() | _tasks()).items():
        scenarios[f"{name}-single"] = Rollout(environment_id, keywords)
        scenarios[f"{name}-batch"] = Rollout(environment_id, keywords, is_batch=True)
    for mode in ("SameStep", "Disabled"):
        for environment_id in ("PCM/2RFR-Reach-v0", "PCM/3PFR-Track-v0"):
            scenarios[f"{_short(environment_id)}-{mode}-batch"] = Rollout(
                environment_id, {"autoreset_mode": mode}, is_batch=True
            )
    for name in FAMILIES:
        scenarios[f"{name}-Reach-from-anywhere"] = _given(name, "anywhere", "continue")
    for behaviour in BEHAVIOURS:
        scenarios[f"fork-Reach-{behaviour}"] = _given("2RFR", "fork", behaviour)
    for behaviour in ("snap", "hold"):
        scenarios[f"restless-Reach-{behaviour}"] = _given("3PFR", "restless", behaviour)
    return scenarios


ROLLOUTS = _scenarios()
