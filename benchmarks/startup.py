"""From a fresh process to the first step, with warm caches and with none."""

import json
import os
import subprocess
import sys
import tempfile
import time

from benchmarks.timing import Measure

STAGES = ("import_gymnasium", "import", "make", "reset", "step")

# Prints the seconds of each stage, of the clock and of the processor; the process itself, Python's own start included,
# is timed from outside.
_SCRIPT = """
import json, sys, time
times, start = {}, (time.perf_counter(), time.process_time())
def stage(name):
    global start
    now = (time.perf_counter(), time.process_time())
    times[name + "_seconds"], times[name + "_processor_seconds"] = now[0] - start[0], now[1] - start[1]
    start = now
import gymnasium
stage("import_gymnasium")
import pcm_gym
stage("import")
env = gymnasium.make(sys.argv[1])
stage("make")
env.reset(seed=0)
stage("reset")
env.step(env.action_space.sample())
stage("step")
print(json.dumps(times))
"""


def startup(environment_id: str, *, is_cold: bool = False, show_progress: bool = False) -> Measure:
    """Return a measure of the seconds of each stage in a fresh process, of the clock and of the processor.

    If cold, the cache of kernels is empty. What the process says on standard error is dropped, or passed on.
    """

    def measure() -> dict[str, float]:
        with tempfile.TemporaryDirectory() as folder:
            environment = {**os.environ, "NUMBA_CACHE_DIR": folder} if is_cold else dict(os.environ)
            before, used_before = time.perf_counter(), _processor_seconds()
            result = subprocess.run(
                [sys.executable, "-c", _SCRIPT, environment_id],
                env=environment,
                stdout=subprocess.PIPE,
                stderr=None if show_progress else subprocess.DEVNULL,
                text=True,
                check=True,
            )
            total, used = time.perf_counter() - before, _processor_seconds() - used_before
        times: dict[str, float] = json.loads(result.stdout)
        return {"total_seconds": total, "total_processor_seconds": used, **times}

    if not is_cold:
        measure()  # fills the caches
    return measure


def _processor_seconds() -> float:
    """Return the processor's seconds of all processes that this one has started and that have ended."""
    times = os.times()
    return times.children_user + times.children_system
