"""Episodes recorded for the report's player: every rod exactly as the solver has it, in compact numbers."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

import pcm_gym
from agents.controllers import RandomController, ResolvedRateController, TrainedController
from agents.evaluation import Evaluation
from agents.rollouts import Controller, EpisodeResult, RunningEpisode, SingleEnv, run_episodes

Json = dict[str, Any]

ROD_POINTS = 40
RESOLUTION_M = 1e-4
TRAINED_EPISODES = 6
TRAINED_FAILURES = 2
VIOLATIONS_OF_OTHERS = 1


@dataclass
class Recorder:
    """Keeps one frame per step of every episode it is shown."""

    frames: dict[int, list[Json]] = field(default_factory=dict)

    def __call__(self, episode: RunningEpisode) -> None:
        """Record the present state of the episode."""
        env: Any = episode.env.unwrapped
        self.frames.setdefault(episode.seed, []).append(_frame(episode, env.equilibrium, env.goal))

    def recording(self, result: EpisodeResult) -> Json:
        """What the player needs of a finished episode."""
        return {"seed": result.seed, "outcome": outcome(result), "frames": self.frames[result.seed]}


def record(evaluation: Evaluation, trained: TrainedController, envs: Sequence[SingleEnv]) -> Json:
    """Everything the player draws, ready for JSON; lengths are whole multiples of `RESOLUTION_M`.

    The first episodes of the trained policy, those of its failures that come first, and one loss of stability of each
    of the other policies.
    """
    env: Any = envs[0].unwrapped
    recordings = _recordings(trained, _trained_seeds(_results_of(evaluation, trained)), envs)
    for other in (RandomController(), ResolvedRateController()):
        recordings += _recordings(other, _violations(_results_of(evaluation, other)), envs)
    return {
        "resolution": RESOLUTION_M,
        "success_distance": env.success_distance,
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


def _results_of(evaluation: Evaluation, controller: Controller) -> list[EpisodeResult]:
    return [result for result in evaluation.results if result.policy == controller.name]


def _trained_seeds(results: Sequence[EpisodeResult]) -> list[int]:
    failures = [result.seed for result in results[TRAINED_EPISODES:] if not result.is_safe_success]
    return [result.seed for result in results[:TRAINED_EPISODES]] + failures[:TRAINED_FAILURES]


def _violations(results: Sequence[EpisodeResult]) -> list[int]:
    return [result.seed for result in results if result.is_violation][:VIOLATIONS_OF_OTHERS]


def _recordings(controller: Controller, seeds: Sequence[int], envs: Sequence[SingleEnv]) -> list[Json]:
    recorder = Recorder()
    results = list(run_episodes(envs, controller, seeds, recorder))
    return [{"policy": controller.name} | recorder.recording(result) for result in results]


def _frame(episode: RunningEpisode, equilibrium: pcm_gym.Equilibrium, goal: NDArray[np.float64]) -> Json:
    info = episode.infos[-1] if episode.infos else {}
    is_unstable = not equilibrium.is_stable or info.get("cost_unstable", 0.0) > 0.0
    return {
        "rods": [_whole(rod.ravel()) for rod in equilibrium.shape(ROD_POINTS)],
        "tip": _whole(equilibrium.pose[:2]),
        "goal": _whole(goal[:2]),
        "goal_hinges": _whole(equilibrium.mechanism.hinges(goal)),
        "error": round(episode.position_error(), 5),
        "margin": _rounded(info.get("stability_margin")),
        "event": str(info.get("event", "none")).replace("_", " "),
        "unstable": bool(is_unstable),
    }


def _actuator(actuator: pcm_gym.Revolute | pcm_gym.Prismatic) -> Json:
    base = np.array(actuator.base, dtype=np.float64)
    if isinstance(actuator, pcm_gym.Revolute):
        return {"kind": "revolute", "base": _whole(base)}
    axis = np.array([np.cos(actuator.axis_angle), np.sin(actuator.axis_angle)])
    return {"kind": "prismatic", "rail": [_whole(base + limit * axis) for limit in actuator.limits]}


def _whole(lengths: NDArray[np.float64]) -> Any:
    return np.rint(np.asarray(lengths) / RESOLUTION_M).astype(int).tolist()


def _rounded(value: float | None) -> float | None:
    return None if value is None or not np.isfinite(value) else float(f"{value:.4g}")
