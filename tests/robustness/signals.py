"""Interruptions at random moments of public calls: each is a KeyboardInterrupt, soon, and the next call is right.

From the repository's root:

    python -m tests.robustness.signals                                  # 40 of each call, some ten minutes
    python -m tests.robustness.signals --count 5 --call env.step --call certify
"""

import argparse
import json
import os
import select
import signal
import subprocess
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

import numpy as np

from tests.robustness.calls import CALLS, FRESH

ROOT = Path(__file__).parents[2]
# How soon a call must end, s; of the process's own time, as others may use the processor.
SOON = 1.0
_PATIENCE = 300.0
# Signals come up to so long after a call begins, s.
_LONGEST_DELAY = 4.0


@dataclass
class Findings:
    """What became of the interruptions of one call."""

    latencies: list[float] = field(default_factory=list)  # s, of the process's own time
    delays: list[float] = field(default_factory=list)  # s, on the clock
    faults: list[str] = field(default_factory=list)

    @property
    def late(self) -> int:
        """How many were noticed too late."""
        return sum(latency > SOON for latency in self.latencies)

    def __str__(self) -> str:
        """Return a line."""
        largest, on_clock = max(self.latencies, default=0.0), max(self.delays, default=0.0)
        count = len(self.latencies) + len(self.faults)
        line = f"{count} signals, {len(self.faults)} faults, {self.late} late, "
        line += f"slowest {largest:.3f} s of processor time ({on_clock:.3f} s on the clock)"
        return "\n    ".join([line, *self.faults])


class Process:
    """A process that waits to be interrupted; see `interrupted`."""

    def __init__(self) -> None:
        command = [sys.executable, "-m", "tests.robustness.interrupted"]
        self._process = subprocess.Popen(command, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=0)
        self._buffer = b""
        self.heard()

    def __enter__(self) -> "Process":
        """Return the process."""
        return self

    def __exit__(self, *_: object) -> None:
        """Let it end, or end it."""
        self._pipe(self._process.stdin).close()
        try:
            self._process.wait(10.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._pipe(self._process.stdout).close()

    def ask(self, name: str) -> None:
        """Let it make a call."""
        self._pipe(self._process.stdin).write(name.encode() + b"\n")

    def interrupt(self) -> tuple[float, float]:
        """Send the signal; return the time on the clock and the process's own."""
        moments = time.monotonic(), self._own_time()
        self._process.send_signal(signal.SIGINT)
        return moments

    def _own_time(self) -> float:
        """Return the processor time that the process has used, s; -inf where the system does not tell."""
        try:
            return time.clock_gettime((~self._process.pid << 3) | 2)  # what clock_getcpuclockid() of Linux returns
        except (AttributeError, OSError):
            return -np.inf

    def heard(self) -> dict[str, Any]:
        """Return the next thing that the process says, or how it ended."""
        pipe, deadline = self._pipe(self._process.stdout), time.monotonic() + _PATIENCE
        while b"\n" not in self._buffer:
            ready, _, _ = select.select([pipe], [], [], max(0.0, deadline - time.monotonic()))
            if not ready:
                return {"state": "wrong", "why": f"nothing heard for {_PATIENCE:g} s: the interruption is lost"}
            new = os.read(pipe.fileno(), 4096)
            if not new:
                return {"state": "dead", "why": f"the process ended with {self._process.wait()}"}
            self._buffer += new
        line, _, self._buffer = self._buffer.partition(b"\n")
        said: dict[str, Any] = json.loads(line)
        return said

    @staticmethod
    def _pipe(pipe: IO[bytes] | None) -> IO[bytes]:
        assert pipe is not None
        return pipe


def ask_for_answer(process: Process, name: str) -> tuple[float, str]:
    """Return how long a call takes, s, and the answer to it where nothing is interrupted."""
    process.ask("?" + name)
    seconds: float = process.heard()["seconds"]
    return min(seconds, _LONGEST_DELAY), process.heard()["digest"]


def interrupt_once(process: Process, name: str, delay: float, expected: str, findings: Findings) -> bool:
    """Interrupt a call after a delay, s; return whether that and the next call went well."""
    process.ask(name)
    said = process.heard()
    if said["state"] == "running":
        time.sleep(delay)
        clock, own = process.interrupt()
        said = process.heard()
    if said["state"] != "interrupted":
        findings.faults.append(said["why"])
        return False
    on_clock = said["wall"] - clock
    answer = process.heard()
    if answer["state"] != "answered" or answer["digest"] != expected:
        findings.faults.append(answer.get("why", "the next call gave another result"))
        return False
    findings.delays.append(on_clock)
    findings.latencies.append(min(on_clock, said["processor"] - own) if own >= 0.0 else on_clock)
    return True


def interrupt_often(name: str, count: int, seed: int = 0) -> Findings:
    """Interrupt a call so often: in one process, as long as that goes well, but each in a new one where it must be."""
    numbers, findings = np.random.default_rng(seed), Findings()
    with Process() as process:
        longest, expected = ask_for_answer(process, name)
    left = count
    while left > 0:
        with Process() as process:
            if name not in FRESH:
                ask_for_answer(process, name)
            goes_on = True
            while left > 0 and goes_on:
                goes_on = interrupt_once(process, name, longest * numbers.random(), expected, findings)
                goes_on, left = goes_on and name not in FRESH, left - 1
    return findings


def interrupt_all(names: list[str], count: int, seed: int = 0) -> dict[str, Findings]:
    """Interrupt calls, each so often, all in one process up to the first fault."""
    numbers, found = np.random.default_rng(seed), {name: Findings() for name in names}
    with Process() as process:
        for name, findings in found.items():
            longest, expected = ask_for_answer(process, name)
            for _ in range(count):
                if not interrupt_once(process, name, longest * numbers.random(), expected, findings):
                    return found
    return found


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=40, help="interruptions of each call (40)")
    parser.add_argument("--call", action="append", choices=list(CALLS), help="this call; all by default")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    is_sound = True
    for name in arguments.call or list(CALLS):
        findings = interrupt_often(name, arguments.count, arguments.seed)
        print(f"{name}: {findings}", flush=True)
        is_sound = is_sound and not findings.faults and not findings.late
    return 0 if is_sound else 1


if __name__ == "__main__":
    sys.exit(main())
