"""Episodes recorded for the report's player: every rod exactly as the solver has it, in compact numbers."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

import pcm_gym
from agents.evaluation.comparison import Evaluation
from agents.evaluation.episodes import EpisodeResult
from agents.evaluation.rollouts import position_error, run_episodes
from pcm_gym.environments.batch import MechanismVectorEnv
from pcm_gym.references import Controller

Json = dict[str, Any]

ROD_POINTS = 40
RESOLUTION_M = 1e-4
JUDGED_EPISODES = 6
JUDGED_FAILURES = 2
VIOLATIONS_OF_OTHERS = 1


@dataclass
class Recorder:
    """Keeps one frame per step of every episode of the batch that it is shown, by seed."""

    env: MechanismVectorEnv
    frames: dict[int, list[Json]] = field(default_factory=dict)

    def __call__(self, row: int, seed: int, infos: Mapping[str, Any]) -> None:
        """Record the present state of the episode in a row."""
        info = {key: infos[key][row] for key in infos}
        frame = _frame(self.env.equilibrium(row), self.env.goal(row), info)
        self.frames.setdefault(seed, []).append(frame)

    def recording(self, result: EpisodeResult) -> Json:
        """What the player needs of a finished episode."""
        return {
            "policy": result.policy,
            "seed": result.seed,
            "outcome": outcome(result),
            "frames": self.frames[result.seed],
        }


def record(evaluation: Evaluation, controllers: Mapping[str, Controller], env: MechanismVectorEnv) -> Json:
    """Everything the player draws, ready for JSON; lengths are whole multiples of `RESOLUTION_M`.

    The first episodes of the judged controller, those of its failures that come first, and one loss of stability of
    each of the others.
    """
    recordings: list[Json] = []
    for place, (name, controller) in enumerate(controllers.items()):
        results = [result for result in evaluation.results if result.policy == name]
        seeds = _judged_seeds(results) if place == 0 else _violations(results)
        recorder = Recorder(env)
        recorded = run_episodes(env, name, controller, seeds, recorder)
        recordings += map(recorder.recording, sorted(recorded, key=lambda result: result.episode))
    return {
        "resolution": RESOLUTION_M,
        "success_distance": env.task.goals.success_distance,
        "actuators": [_actuator(leg.actuator) for leg in env.mechanism.legs],
        "episodes": recordings,
    }


def outcome(result: EpisodeResult) -> str:
    """What the episode came to, in two or three words."""
    if result.is_violation:
        return "stability lost"
    if result.is_solver_failure:
        return "solver failed"
    if not result.is_success:
        return "goal not reached"
    return "goal reached" if result.is_safe_success else "goal reached, at a cost"


def _judged_seeds(results: Sequence[EpisodeResult]) -> list[int]:
    failures = [result.seed for result in results[JUDGED_EPISODES:] if not result.is_safe_success]
    return [result.seed for result in results[:JUDGED_EPISODES]] + failures[:JUDGED_FAILURES]


def _violations(results: Sequence[EpisodeResult]) -> list[int]:
    return [result.seed for result in results if result.is_violation][:VIOLATIONS_OF_OTHERS]


def _frame(equilibrium: pcm_gym.Equilibrium, goal: NDArray[np.float64], info: Mapping[str, Any]) -> Json:
    is_unstable = not equilibrium.is_stable or info.get("cost_unstable", 0.0) > 0.0
    return {
        "rods": [_whole(rod.ravel()) for rod in equilibrium.shape(ROD_POINTS)],
        "tip": _whole(equilibrium.pose[:2]),
        "goal": _whole(goal[:2]),
        "goal_hinges": _whole(equilibrium.mechanism.hinges(goal)),
        "error": round(position_error(goal, equilibrium.pose), 5),
        "margin": _rounded(info.get("stability_margin")),
        "event": str(pcm_gym.Event(info.get("event", 0))).replace("_", " "),
        "unstable": bool(is_unstable),
    }


def _actuator(actuator: pcm_gym.Revolute | pcm_gym.Prismatic) -> Json:
    if actuator.is_angle:
        return {"kind": "revolute", "base": _whole(actuator.base)}
    return {"kind": "prismatic", "rail": [_whole(actuator.clamp_point(limit)) for limit in actuator.limits]}


def _whole(lengths: ArrayLike) -> Any:
    return np.rint(np.asarray(lengths) / RESOLUTION_M).astype(int).tolist()


def _rounded(value: float | None) -> float | None:
    return None if value is None or not np.isfinite(value) else float(f"{value:.4g}")
