"""From a fresh process to the first step, with warm caches and with none."""

import json
import os
import subprocess
import sys
import tempfile
import time

from benchmarks.timing import Measure

# Prints the seconds of each stage; the process itself, Python's own start included, is timed from outside.
_SCRIPT = """
import json, sys, time
clock, times = time.perf_counter, {}
def stage(name, start):
    times[name] = clock() - start
start = clock()
import gymnasium
stage("import_gymnasium_seconds", start); start = clock()
import pcm_gym
stage("import_seconds", start); start = clock()
env = gymnasium.make(sys.argv[1])
stage("make_seconds", start); start = clock()
env.reset(seed=0)
stage("reset_seconds", start); start = clock()
env.step(env.action_space.sample())
stage("step_seconds", start)
print(json.dumps(times))
"""


def startup(environment_id: str, *, is_cold: bool = False) -> Measure:
    """Return a measure of the seconds of each stage in a fresh process; if cold, with an empty cache of kernels."""

    def measure() -> dict[str, float]:
        with tempfile.TemporaryDirectory() as folder:
            environment = {**os.environ, "NUMBA_CACHE_DIR": folder} if is_cold else dict(os.environ)
            before = time.perf_counter()
            result = subprocess.run(
                [sys.executable, "-c", _SCRIPT, environment_id],
                env=environment,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                text=True,
                check=True,
            )
            total = time.perf_counter() - before
        times: dict[str, float] = json.loads(result.stdout)
        return {"total_seconds": total, **times}

    if not is_cold:
        measure()  # fills the caches
    return measure
