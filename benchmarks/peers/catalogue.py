"""Every peer by name, and how those that are asked for are made ready."""

import warnings
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from benchmarks.peers import (
    collocation,
    compiled_shooting,
    elastica_loop,
    environments,
    mujoco_chain,
    ours,
    shooting,
)
from benchmarks.peers.following import Peer, follow
from benchmarks.timing import Measure

_ROWS = 1024
_VERDICT = "stability, fold, branch"
_TIP_ALONE = "nothing"
_AT_REST = "at rest: stable"

BATCH = f"pcm_gym, batch of {_ROWS}"
ONE = "pcm_gym, one environment"
OURS = {
    BATCH: Peer(ours.prepare_batch, "native batch, one thread, observation and info", _VERDICT, _ROWS),
    ONE: Peer(ours.prepare_environment, "gymnasium.make, observation and info", _VERDICT),
    "pcm_gym, BranchTracker": Peer(ours.prepare_tracker, "no environment", _VERDICT),
}
FOLLOWERS = {
    "Numba RK4 shooting": Peer(
        compiled_shooting.prepare, "20 steps a rod, exact Newton, guess from the last two", _TIP_ALONE
    ),
    f"Numba RK4 shooting, batch of {_ROWS}": Peer(
        compiled_shooting.prepare, "the same, rows in a compiled loop", _TIP_ALONE, _ROWS
    ),
    "SciPy odeint and root": Peer(shooting.prepare, f"tolerances {shooting.TOL:g}, warm start", _TIP_ALONE),
    "SciPy solve_bvp, 1e-3": Peer(
        partial(collocation.prepare, tol=1e-3), "tolerance 1e-3, exact Jacobian, warm mesh", _TIP_ALONE
    ),
    "SciPy solve_bvp, 1e-6": Peer(
        partial(collocation.prepare, tol=1e-6), "tolerance 1e-6, exact Jacobian, warm mesh", _TIP_ALONE
    ),
    "MuJoCo chain, 20 links": Peer(
        partial(mujoco_chain.prepare, links=20, steps=6), "armature in proportion, 6 mj_step to settle", _AT_REST
    ),
    "MuJoCo chain, 50 links": Peer(
        partial(mujoco_chain.prepare, links=50, steps=8), "armature in proportion, 8 mj_step to settle", _AT_REST
    ),
    "PyElastica loop, 20 elements": Peer(
        partial(elastica_loop.prepare, elements=20, radius=0.03, damping=12.0, settling=0.4),
        "radius 0.03 L, damping 12, 0.4 units of time to settle",
        _AT_REST,
    ),
    "PyElastica loop, 50 elements": Peer(
        partial(elastica_loop.prepare, elements=50, radius=0.015, damping=15.0, settling=0.6),
        "radius 0.015 L, damping 15, 0.6 units of time to settle",
        _AT_REST,
    ),
}
# Tasks of their own, for scale: from the seconds of a measurement to the measure and how it was set up.
ENVIRONMENTS: dict[str, Callable[[float], tuple[Measure, str]]] = {
    "gym-softrobot": environments.make_softrobot,
    "CartPole, Gymnasium": environments.make_cart_pole,
    f"CartPole, EnvPool, batch of {_ROWS}": environments.make_cart_pole_batch,
}
PEERS = (*FOLLOWERS, *ENVIRONMENTS)


@dataclass(frozen=True)
class Ready:
    """What was made ready: measures, how each is set up, and why those that are not there are absent."""

    measures: dict[str, Measure] = field(default_factory=dict)
    setups: dict[str, str] = field(default_factory=dict)
    absent: dict[str, str] = field(default_factory=dict)


def prepare(names: Iterable[str], seconds: float, progress: Callable[[], Any]) -> Ready:
    """Return ourselves and these peers, compiled and at the start of the path."""
    ready = Ready()
    for name in (*OURS, *names):
        try:
            with warnings.catch_warnings(action="ignore"):  # about the packages of others, to those who write them
                measure, setup = _make(name, seconds)
                measure()  # what compiles, compiles here
        except Exception as error:  # of whatever kind: a package of theirs that does not load or run here
            if name in OURS:
                raise
            ready.absent[name] = f"{type(error).__name__}: {error}".splitlines()[0]
        else:
            ready.measures[name], ready.setups[name] = measure, setup
        progress()
    return ready


def _make(name: str, seconds: float) -> tuple[Measure, str]:
    if name in ENVIRONMENTS:
        return ENVIRONMENTS[name](seconds)
    peer = (OURS | FOLLOWERS)[name]
    return follow(peer, seconds), peer.setup
