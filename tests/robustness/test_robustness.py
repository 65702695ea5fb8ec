"""A sample of what `signals` and `kills` do to public calls.

The whole of it: ``python -m tests.robustness.signals`` and ``python -m tests.robustness.kills``.
"""

import signal
import threading
import time
from pathlib import Path

import numpy as np
import pytest

import pcm_gym
from pcm_gym.kernels.numerics.threads import run_all
from tests.robustness.calls import CALLS, IMPORT
from tests.robustness.kills import kill_compilations
from tests.robustness.signals import interrupt_all, interrupt_often

# Those that take a second or more are left to the whole.
SHORT = ["env.step", "batch.step", "solve_forward", "BranchTracker.step", "nearest_fold", "snap, find_falls"]


def test_interruptions_are_keyboard_interrupts_and_the_next_call_is_right() -> None:
    assert set(SHORT) < set(CALLS)
    for name, findings in [(IMPORT, interrupt_often(IMPORT, 1)), *interrupt_all(SHORT, 2).items()]:
        assert not findings.faults, (name, findings.faults)
        assert len(findings.latencies) == (1 if name == IMPORT else 2)
        assert findings.late == 0, (name, findings.latencies)


def test_handler_that_returns_disturbs_no_search() -> None:
    """A handler may be anybody's, and go on; what is computed then is the same."""
    platform, heard = pcm_gym.get_mechanism("3PFR"), []
    expected = pcm_gym.solve_forward(platform, np.array(platform.home_inputs), rho_max=6.5)
    before = signal.signal(signal.SIGINT, lambda *_: heard.append(time.monotonic()))
    timers = [threading.Timer(0.03 * n, signal.raise_signal, [signal.SIGINT]) for n in range(1, 6)]
    try:
        for timer in timers:
            timer.start()
        found = pcm_gym.solve_forward(platform, np.array(platform.home_inputs), rho_max=6.5)
        for timer in timers:
            timer.join()
    finally:
        signal.signal(signal.SIGINT, before)
    assert len(heard) > 0
    assert [one.state.tolist() for one in found] == [one.state.tolist() for one in expected]


def test_nothing_runs_on_after_a_job_that_fails() -> None:
    running, done = threading.Event(), []

    def fail_or_wait() -> None:
        if threading.current_thread() is threading.main_thread():
            running.wait(5.0)
            raise KeyboardInterrupt
        running.set()
        time.sleep(0.1)
        done.append(True)

    with pytest.raises(KeyboardInterrupt):
        run_all([fail_or_wait, fail_or_wait, *[lambda: done.append(False)] * 50], 2)
    count = len(done)
    time.sleep(0.2)
    assert len(done) == count


def test_nothing_runs_on_where_the_caller_is_interrupted_while_it_waits() -> None:
    begun, done, caller = threading.Event(), [], threading.get_ident()
    timers = [threading.Timer(seconds, signal.pthread_kill, [caller, signal.SIGINT]) for seconds in (0.1, 0.2)]

    def outlast_the_caller() -> None:
        if threading.current_thread() is threading.main_thread():
            begun.wait(5.0)
            return
        for timer in timers:
            timer.start()
        begun.set()
        time.sleep(0.4)
        done.append(True)

    with pytest.raises(KeyboardInterrupt):
        run_all([outlast_the_caller, outlast_the_caller], 2)
    assert done == [True]


def test_killed_compilation_leaves_a_cache_that_serves(tmp_path: Path) -> None:
    assert kill_compilations(1, tmp_path) == []
