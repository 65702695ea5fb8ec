"""Processes killed at random moments, and what they leave behind: a training, and a compilation.

From the repository's root:

    python -m tests.robustness.kills            # ten of each, some minutes
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[2]
# A training of some seconds that keeps a snapshot every few updates.
EXPERIMENT = """\
name: killed
environment: {id: PCM/2RFR-Reach-v0}
hyperparameters: {n_steps: 32, batch_size: 64, n_epochs: 1, policy_kwargs: {net_arch: [8]}}
num_envs: 4
total_steps: 4096
checkpoint_every: 256
evaluation: {episodes: 2}
"""
# Every snapshot that looks complete is loaded; the run's own model too.
LOAD_ALL = """\
import sys
from pathlib import Path
import gymnasium
from stable_baselines3 import PPO
from agents.experiments.runs import RunFolder
run = RunFolder(Path(sys.argv[1]))
for folder in run.snapshots():
    PPO.load(folder / "model.zip", device="cpu")
if (run.path / "model.zip").exists():
    PPO.load(run.path / "model.zip", device="cpu")
print(len(run.snapshots()))
"""
# Some kernels that are compiled in a few seconds.
COMPILE = """\
from pcm_gym.kernels.enumeration.cells import grid_angle, node_offset
from pcm_gym.kernels.rods.elliptic import jacobi, quarter_period
print(quarter_period(0.5), jacobi(1.0, 0.6, 0.8), grid_angle(3.0, 0.4), node_offset(3))
"""


def run(arguments: list[str], variables: Mapping[str, str] | None = None) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, **(variables or {})}
    return subprocess.run(
        [sys.executable, *arguments], cwd=ROOT, env=environment, capture_output=True, text=True, check=False
    )


def run_until(moment: float, arguments: list[str], variables: Mapping[str, str] | None = None) -> bool:
    """Run Python and kill it at a moment, s; return whether it was still running."""
    process = subprocess.Popen(
        [sys.executable, *arguments],
        cwd=ROOT,
        env={**os.environ, **(variables or {})},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        process.wait(moment)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
        return True
    return False


def kill_trainings(count: int, folder: Path, seed: int = 0) -> list[str]:
    """Kill a training, and each time let what is left be read and gone on with; return what went wrong."""
    config = folder / "killed.yaml"
    config.write_text(EXPERIMENT)
    command, faults = ["-m", "agents.train", str(config), "--runs-dir", str(folder)], []
    started = time.monotonic()
    whole = run(command)
    longest, numbers = time.monotonic() - started, np.random.default_rng(seed)
    if whole.returncode:
        return [f"the training itself fails: {whole.stderr}"]
    for n in range(count):
        run_until(longest * numbers.uniform(0.2, 1.0), [*command, "--force"])
        loaded = run(["-c", LOAD_ALL, str(folder / "killed")])
        if loaded.returncode:
            faults.append(f"kill {n}: a snapshot is damaged: {loaded.stderr}")
            continue
        resumed = run([*command, "--resume" if int(loaded.stdout) else "--force"])
        if resumed.returncode:
            faults.append(f"kill {n}: the run cannot be gone on with: {resumed.stdout}{resumed.stderr}")
    return faults


def kill_compilations(count: int, folder: Path, seed: int = 0) -> list[str]:
    """Kill a compilation, and each time compile on into the same cache; return what went wrong."""
    faults: list[str] = []
    started = time.monotonic()
    expected = run(["-c", COMPILE], {"NUMBA_CACHE_DIR": str(folder / "whole")})
    longest, numbers = time.monotonic() - started, np.random.default_rng(seed)
    if expected.returncode:
        return [f"the compilation itself fails: {expected.stderr}"]
    for n in range(count):
        cache = {"NUMBA_CACHE_DIR": str(folder / str(n))}
        for _ in range(2):  # the second one begins with what the first one has left
            run_until(longest * numbers.random(), ["-c", COMPILE], cache)
        for _ in range(2):
            found = run(["-c", COMPILE], cache)
            if found.returncode or found.stdout != expected.stdout:
                faults.append(f"kill {n}: {found.stdout}{found.stderr}")
    return faults


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=10, help="kills of each (10)")
    count = parser.parse_args().count
    is_sound = True
    for name, kill in (("training", kill_trainings), ("compilation", kill_compilations)):
        with tempfile.TemporaryDirectory() as folder:
            faults = kill(count, Path(folder))
        print("\n    ".join([f"{name}: {count} kills, {len(faults)} faults", *faults]), flush=True)
        is_sound = is_sound and not faults
    return 0 if is_sound else 1


if __name__ == "__main__":
    sys.exit(main())
