"""Cells in processes of their own: one that is killed costs its cell and nothing else."""

import multiprocessing
import os
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Sequence
from itertools import islice
from multiprocessing.connection import wait
from multiprocessing.context import SpawnProcess
from multiprocessing.process import parent_process
from pathlib import Path
from types import FrameType

from agents.benchmarking.cells import Cell, ResultsFolder
from agents.benchmarking.work import Asked, result_of
from agents.learners.settings import UsageError

# Nothing of this process, threads of torch and numba above all, may be in the others.
_PROCESSES = multiprocessing.get_context("spawn")


def run_cells(
    cells: Sequence[Cell], asked: Asked, folder: ResultsFolder, jobs: int, ended: Callable[[Cell, str | None], None]
) -> None:
    """Work on all cells, `jobs` at once; what they come to is in the folder afterwards.

    Parameters
    ----------
    cells
        In the order in which they are begun.
    asked
        What is asked for beside the cells.
    folder
        Where the results go.
    jobs
        How many processes there are at once.
    ended
        Told of every cell that has ended, and why it came to nothing, if it did.

    Raises
    ------
    KeyboardInterrupt
        Passed on, after those under way have saved where they are.
    """
    waiting = iter(cells)
    running: dict[int, tuple[SpawnProcess, Cell]] = {}
    try:
        while True:
            for cell in islice(waiting, jobs - len(running)):
                process = _PROCESSES.Process(target=_work, args=(cell, asked, folder), name=cell.name)
                process.start()
                running[process.sentinel] = process, cell
            if not running:
                return
            for sentinel in wait(list(running)):
                assert isinstance(sentinel, int)
                process, cell = running.pop(sentinel)
                process.join()
                if process.exitcode:
                    folder.fail(cell, f"its process was ended: exit code {process.exitcode}")
                ended(cell, folder.failure(cell))
    finally:
        for process, _ in running.values():
            process.terminate()
        for process, _ in running.values():
            process.join()


def log_of(cell: Cell, asked: Asked) -> Path:
    """Where a cell's process writes what it has to say."""
    return asked.runs / f"{cell.name}.log"


def _work(cell: Cell, asked: Asked, folder: ResultsFolder) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the terminal tells all; whoever started this one decides
    signal.signal(signal.SIGTERM, _interrupt_once)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    _write_to(log_of(cell, asked))
    try:
        folder.succeed(cell, result_of(cell, asked))
    except KeyboardInterrupt:
        sys.exit("interrupted")
    except Exception as error:
        traceback.print_exc()
        folder.fail(cell, str(error) if isinstance(error, UsageError) else f"{type(error).__name__}: {error}")


def _interrupt_once(number: int, frame: FrameType | None) -> None:
    """Interrupt what goes on; a second request, from whoever sends it, must not interrupt what is saved then."""
    signal.signal(number, signal.SIG_IGN)
    raise KeyboardInterrupt


def _end_with_parent() -> None:
    """End at once when the parent is killed: the next run of the benchmark must meet no other one in its folders."""
    parent = parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)


def _write_to(path: Path) -> None:
    """Let all output, that of compiled code too, go to a file."""
    with path.open("a", encoding="utf-8") as file:
        for stream in (sys.stdout, sys.stderr):
            os.dup2(file.fileno(), stream.fileno())
