"""What users do, each once and as small as it can be: so that all that it needs is compiled."""

from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np

import pcm_gym

_MECHANISM = "2PFR"  # of the three the one whose sets come soonest


def _mechanism() -> pcm_gym.Mechanism:
    return pcm_gym.get_mechanism(_MECHANISM)


def _home() -> pcm_gym.Equilibrium:
    return pcm_gym.home_equilibrium(_mechanism())


def _solve() -> None:
    home = _home()
    pcm_gym.solve_forward(home.mechanism, home.inputs)
    pcm_gym.solve_inverse(home.mechanism, home.pose)
    home.shape(2)


def _prove() -> None:
    home = _home()
    pcm_gym.solve_forward(home.mechanism, home.inputs, rho_max=4.0, certify=True)
    pcm_gym.solve_inverse(home.mechanism, home.pose, rho_max=4.0, certify=True)
    pcm_gym.BranchTracker(home.mechanism, home, certify=True).step(home.inputs + 0.01)


def _follow() -> None:
    mechanism = pcm_gym.get_mechanism("2RFR")
    home = pcm_gym.home_equilibrium(mechanism)
    pcm_gym.nearest_fold(home, 0.1)
    fold = pcm_gym.BranchTracker(mechanism, home).step((0.3, 6.0))
    pcm_gym.snap(fold.equilibrium)
    pcm_gym.critical_load(home)
    pcm_gym.plan_motion(home, {"inputs": home.inputs + 0.1})


def _step() -> None:
    for task in ("Reach", "Track", "Switch"):
        env: Any = gymnasium.make(f"PCM/{_MECHANISM}-{task}-v0", on_instability="snap")
        env.reset(seed=0)
        env.step(env.action_space.sample())
    env.unwrapped.preview(np.zeros((2, 2)))
    loaded = gymnasium.make(f"PCM/{_MECHANISM}-Reach-v0", load=(0.0, -0.01))  # of which nothing comes with the package
    loaded.reset(seed=0)
    loaded.reset(options={"inputs": _home().inputs})  # a pose at which lock-step refuses to judge


def _step_batches() -> None:
    envs = gymnasium.make_vec(f"PCM/{_MECHANISM}-Reach-v0", num_envs=64, vectorization_mode="vector_entry_point")
    envs.reset(seed=0)
    for _ in range(10):  # some rows of which lose stability
        envs.step(np.ones(envs.action_space.shape, np.float32))


def _chart() -> None:
    mechanism = _mechanism()
    atlas = pcm_gym.build_atlas(mechanism, pitch=0.2, input_cells=4, seed_nodes=1, progress=False)
    atlas.at_pose(_home().pose)
    atlas.branch_of(_home())
    window: dict[str, Any] = {"bounds": [(-0.25, 0.25)] * 2, "grid": 1, "progress": False}
    pcm_gym.find_crossings(pcm_gym.forward_singularities(mechanism, **window))
    pcm_gym.inverse_singularities(mechanism, **window)


STAGES: dict[str, Callable[[], None]] = {
    "all equilibria": _solve,
    "folds and falls": _follow,
    "environments": _step,
    "batches": _step_batches,
    "charts and singular curves": _chart,
    "proofs": _prove,
}
