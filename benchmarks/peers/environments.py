"""Environments of others, for scale: their own tasks with random actions, time of resets left out.

They do not hold our mechanism, so nothing but steps per second is compared, and a step is what each calls a step.
"""

import gymnasium

from benchmarks.batch import BATCH_SIZES, peer_throughput
from benchmarks.single import throughput
from benchmarks.timing import Measure

_CART_POLE = "CartPole-v1"
_RATE = "steps_per_second_without_resets"


def make_softrobot(seconds: float) -> tuple[Measure, str]:
    """Return the measure of the fastest environment of gym-softrobot, and which of them run."""
    import gym_softrobot  # noqa: F401 (registers its environments)

    rates, reasons = {}, []
    for name in [name for name, spec in gymnasium.registry.items() if "gym_softrobot" in str(spec.entry_point)]:
        try:
            rates[name] = throughput(gymnasium.make(name), 0.2 * seconds, block=1)()[_RATE]
        except Exception as error:  # of whatever kind: an environment of theirs that does not run
            reasons.append(f"{type(error).__name__}: {error}".splitlines()[0])
    reason = max(set(reasons), key=reasons.count, default="")
    if not rates:
        raise RuntimeError(f"none of its environments runs: {reason}")
    best = max(rates, key=lambda name: rates[name])
    setup = f"{best}, the fastest of {len(rates)} that run (the slowest: {min(rates.values()):.2g} steps/s)"
    if reasons:
        setup += f"; {len(reasons)} do not: {reason}"
    return _rate_alone(throughput(gymnasium.make(best), seconds, block=1)), setup


def make_cart_pole(seconds: float) -> tuple[Measure, str]:
    """Return the measure of Gymnasium's CartPole-v1."""
    return _rate_alone(throughput(gymnasium.make(_CART_POLE), seconds)), f"{_CART_POLE} of Gymnasium, one environment"


def make_cart_pole_batch(seconds: float) -> tuple[Measure, str]:
    """Return the measure of EnvPool's CartPole-v1 in one thread."""
    measure = peer_throughput(BATCH_SIZES[-1], 1, seconds)
    return lambda: {
        "steps_per_second": measure()["steps_per_second"]
    }, f"{_CART_POLE} in C++, one thread, resets included"


def _rate_alone(measure: Measure) -> Measure:
    return lambda: {"steps_per_second": measure()[_RATE]}
