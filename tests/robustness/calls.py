"""Public calls that are interrupted, and what tells that the package is whole afterwards."""

import atexit
import math
import os
import tempfile
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np


class Interruptible(NamedTuple):
    """A call, made again and again until the interruption comes, and a check of the next one."""

    call: Callable[[], Any]
    answer: Callable[[], list[Any]]  # arrays that are the same, to the bit, before and after


def import_and_step() -> Interruptible:
    """Import the package, make an environment and step it; the answer is another one's first steps."""

    def rollout() -> list[Any]:
        import gymnasium

        import pcm_gym

        assert pcm_gym.__version__
        env = gymnasium.make("PCM/2RFR-Reach-v0")
        env.reset(seed=0)
        return [env.step(np.full(2, 0.5, np.float32))[0]["observation"] for _ in range(5)]

    return Interruptible(rollout, rollout)


def compilation() -> Interruptible:
    """Compile some kernels, into a cache of their own that is empty at first."""
    folder = tempfile.TemporaryDirectory()
    atexit.register(folder.cleanup)
    os.environ["NUMBA_CACHE_DIR"] = folder.name

    def compiled() -> list[Any]:
        from pcm_gym.kernels.rods.elliptic import jacobi
        from pcm_gym.kernels.rods.rod import rod_energy, rod_parameters

        return [np.array([*jacobi(1.0, 0.6, 0.8), rod_energy(3.0, -4.0), *rod_parameters(3.0, -4.0)])]

    return Interruptible(compiled, compiled)


def env_step() -> Interruptible:
    import gymnasium

    env = gymnasium.make("pcm_gym:PCM/2RFR-Reach-v0", on_instability="snap")
    numbers = np.random.default_rng(0)
    return Interruptible(lambda: _stepped(env, numbers), lambda: _rollout(env))


def _stepped(env: Any, numbers: np.random.Generator) -> None:
    env.reset(seed=int(numbers.integers(100)))
    for _ in range(50):
        env.step(numbers.uniform(-1.0, 1.0, env.action_space.shape).astype(np.float32))


def _rollout(env: Any) -> list[Any]:
    numbers, seen = np.random.default_rng(1), [env.reset(seed=7)[0]["observation"]]
    for _ in range(10):
        observed, reward, *_ = env.step(numbers.uniform(-1.0, 1.0, env.action_space.shape).astype(np.float32))
        seen += [observed["observation"], np.asarray(reward)]
    return seen


def batch_step() -> Interruptible:
    import gymnasium

    env = gymnasium.make_vec(
        "pcm_gym:PCM/3PFR-Reach-v0",
        num_envs=600,
        vectorization_mode="vector_entry_point",
        on_instability="snap",
        threads=2,
    )
    numbers = np.random.default_rng(0)
    return Interruptible(lambda: _stepped(env, numbers), lambda: _rollout(env))


def forward() -> Interruptible:
    """Complete sets with loads for which the rod is tabulated anew each time."""
    import pcm_gym

    mechanism, numbers = pcm_gym.get_mechanism("2RFR"), np.random.default_rng(0)
    inputs = np.array(mechanism.home_inputs)
    return Interruptible(
        lambda: pcm_gym.solve_forward(mechanism, inputs, rho_max=numbers.uniform(4.0, 16.0)),
        lambda: [found.state for found in pcm_gym.solve_forward(mechanism, inputs)],
    )


def inverse() -> Interruptible:
    import pcm_gym

    mechanism, numbers = pcm_gym.get_mechanism("3PFR"), np.random.default_rng(0)
    pose = pcm_gym.home_equilibrium(mechanism).pose
    return Interruptible(
        lambda: pcm_gym.solve_inverse(mechanism, pose, rho_max=numbers.uniform(4.0, 12.0), refinement=1),
        lambda: [found.state for found in pcm_gym.solve_inverse(mechanism, pose, rho_max=6.5)],
    )


def tracker_step() -> Interruptible:
    import pcm_gym

    mechanism, numbers = pcm_gym.get_mechanism("2RFR"), np.random.default_rng(0)
    home = pcm_gym.home_equilibrium(mechanism)

    def answer() -> list[Any]:
        step = pcm_gym.BranchTracker(mechanism, home).step(home.inputs + 0.3)
        return [step.equilibrium.state, np.array(step.fraction)]

    return Interruptible(
        lambda: pcm_gym.BranchTracker(mechanism, home).step(home.inputs + numbers.uniform(-2.0, 2.0, 2)), answer
    )


def nearest_fold() -> Interruptible:
    import pcm_gym

    home = pcm_gym.home_equilibrium(pcm_gym.get_mechanism("3PFR"))
    point = pcm_gym.home_equilibrium(pcm_gym.get_mechanism("2RFR"))

    def answer() -> list[Any]:
        fold = pcm_gym.nearest_fold(point)
        assert fold is not None
        return [fold.equilibrium.state]

    return Interruptible(lambda: pcm_gym.nearest_fold(home), answer)


def falls() -> Interruptible:
    import pcm_gym

    mechanism = pcm_gym.get_mechanism("2RFR")
    roadmap = pcm_gym.build_roadmap(mechanism, [pcm_gym.home_equilibrium(mechanism)])
    unstable = next(
        found for found in pcm_gym.solve_forward(mechanism, np.array(mechanism.home_inputs)) if found.index > 0
    )

    def call() -> None:
        pcm_gym.find_falls(roadmap, 512)
        pcm_gym.snap(unstable)

    return Interruptible(call, lambda: [pcm_gym.find_falls(roadmap, 16), pcm_gym.snap(unstable).equilibrium.state])


def atlas() -> Interruptible:
    import pcm_gym

    mechanism = pcm_gym.get_mechanism("2RFR")

    def answer() -> list[Any]:
        made = pcm_gym.build_atlas(mechanism, progress=False, pitch=0.1, input_cells=12, seed_nodes=2)
        return [made.over_poses.rods, made.over_inputs.branches]

    return Interruptible(
        lambda: pcm_gym.build_atlas(mechanism, progress=False, pitch=0.03, input_cells=32).sample(
            np.random.default_rng(0), 2000
        ),
        answer,
    )


def roadmap() -> Interruptible:
    import pcm_gym

    homes = [pcm_gym.home_equilibrium(pcm_gym.get_mechanism(name)) for name in ("3PFR", "2PFR")]

    def made(home: Any) -> list[Any]:
        built = pcm_gym.build_roadmap(home.mechanism, [home], least_margin=0.05)
        return [built.states, built.ways]

    return Interruptible(lambda: made(homes[0]), lambda: made(homes[1]))


def certify() -> Interruptible:
    import pcm_gym

    mechanism, numbers = pcm_gym.get_mechanism("2RFR"), np.random.default_rng(0)
    inputs = np.array(mechanism.home_inputs)

    def proved(rho_max: float) -> list[Any]:
        found = pcm_gym.solve_forward(mechanism, inputs, rho_max=rho_max, certify=True)
        assert found.certificate is not None
        return [np.array(found.certificate.proved_count), *(one.state for one in found)]

    return Interruptible(lambda: proved(numbers.uniform(9.0, 16.0)), lambda: proved(9.0))


def home() -> Interruptible:
    """The home of a platform with one short rod, at whose home inputs a million starts are looked at."""
    import pcm_gym

    directions = [math.pi / 2.0 + 2.0 * math.pi / 3.0 * n for n in range(3)]
    legs = []
    for direction, length in zip(directions, (1.0, 1.0, 0.1), strict=True):
        x, y = math.cos(direction), math.sin(direction)
        motor = pcm_gym.Revolute(base=(0.35 * x, 0.35 * y), clamp_angle=direction + math.pi + 0.5)
        legs.append(pcm_gym.Leg(motor, pcm_gym.Rod(length, 0.05), attachment=(0.3 * x, 0.3 * y)))
    hard, usual = pcm_gym.Mechanism("one short rod", tuple(legs)), pcm_gym.get_mechanism("3PFR")
    return Interruptible(
        lambda: pcm_gym.home_equilibrium(hard), lambda: [pcm_gym.home_equilibrium(usual, (0.0, 0.0, 0.01)).state]
    )


def render() -> Interruptible:
    import gymnasium

    env: Any = gymnasium.make("pcm_gym:PCM/2RFR-Track-v0", render_mode="rgb_array", disable_env_checker=True)
    env.reset(seed=0)

    def call() -> None:
        env.step(np.full(2, 0.1, np.float32))
        env.render()

    def answer() -> list[Any]:
        env.reset(seed=3)
        return [env.render()]

    return Interruptible(call, answer)


def singularities() -> Interruptible:
    import pcm_gym

    mechanism = pcm_gym.get_mechanism("2RFR")

    def answer() -> list[Any]:
        curves = pcm_gym.forward_singularities(mechanism, rho_max=5.0, index=0, progress=False, grid=3)
        return [curve.unknowns for curve in curves]

    return Interruptible(lambda: pcm_gym.inverse_singularities(mechanism, progress=False, grid=6), answer)


IMPORT, COMPILATION = "import and first step", "compilation"
# Those that only a new interpreter makes.
FRESH = (IMPORT, COMPILATION)
CALLS: dict[str, Callable[[], Interruptible]] = {
    IMPORT: import_and_step,
    COMPILATION: compilation,
    "env.step": env_step,
    "batch.step": batch_step,
    "solve_forward": forward,
    "solve_inverse": inverse,
    "BranchTracker.step": tracker_step,
    "nearest_fold": nearest_fold,
    "snap, find_falls": falls,
    "build_atlas": atlas,
    "build_roadmap": roadmap,
    "certify": certify,
    "home_equilibrium": home,
    "render": render,
    "singularities": singularities,
}
