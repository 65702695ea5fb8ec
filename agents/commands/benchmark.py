"""The command that runs the benchmark."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from agents.commands.errors import errors_in_words
from agents.commands.signals import INTERRUPTED, termination_as_interruption

if TYPE_CHECKING:  # they load numba or torch, which --help does without
    from agents.benchmarking.cells import Cell, ResultsFolder
    from agents.benchmarking.config import BenchmarkConfig

console = Console()


def benchmark(
    config: Annotated[Path, typer.Argument(metavar="CONFIG", help="YAML file that describes the benchmark.")],
    jobs: Annotated[int, typer.Option(min=1, help="Cells at once, each in a process of its own.")] = 1,
    runs_dir: Annotated[Path, typer.Option(help="Folder that holds the training runs.")] = Path("runs"),
    page: Annotated[
        Path | None, typer.Option(help="Run nothing: write a page of what results there are into this file.")
    ] = None,
) -> None:
    """Train and judge every learner and reference in every tier, with every seed.

    What has been done is not done again, so the same command goes on where the last one was ended.
    """
    with errors_in_words(console):
        from agents.benchmarking.cells import ResultsFolder
        from agents.benchmarking.config import load_benchmark

        benchmark = load_benchmark(config)
        folder = ResultsFolder(benchmark.folder)
        if page is not None:
            _write_page(benchmark, config, folder, page)
            return
        failed = _run(benchmark, folder, runs_dir / benchmark.name, jobs)
    if failed:
        raise typer.Exit(code=1)


def _run(benchmark: "BenchmarkConfig", folder: "ResultsFolder", runs: Path, jobs: int) -> int:
    """Do what is not done, one benchmark at a time; return how many cells came to nothing."""
    from agents.benchmarking.lock import alone
    from agents.benchmarking.processes import run_cells
    from agents.benchmarking.scores import COLUMNS, rows_of
    from agents.benchmarking.work import Asked

    folder.create()
    asked = Asked(runs, benchmark.episodes)
    cells = benchmark.cells()
    waiting = [cell for cell in cells if not folder.is_done(cell, benchmark.episodes)]
    failures: list[Cell] = []
    with alone(runs), _bar() as progress:
        task = progress.add_task("cells", total=len(cells), completed=len(cells) - len(waiting))

        def ended(cell: "Cell", reason: str | None) -> None:
            progress.advance(task)
            if reason is not None:
                failures.append(cell)
                progress.console.print(f"{cell.name}: {reason}", style="red", markup=False, soft_wrap=True)

        try:
            with termination_as_interruption():
                run_cells(waiting, asked, folder, jobs, ended)
        except KeyboardInterrupt as error:
            progress.console.print("Interrupted; the same command goes on.", style="yellow")
            raise typer.Exit(code=INTERRUPTED) from error
        finally:
            folder.write_table(COLUMNS, rows_of(folder.results()))
    console.print(f"{len(cells) - len(failures)} of {len(cells)} cells: {folder.table}", markup=False, soft_wrap=True)
    return len(failures)


def _write_page(benchmark: "BenchmarkConfig", source: Path, folder: "ResultsFolder", path: Path) -> None:
    from agents.benchmarking.page import page

    path.write_text(page(benchmark, source, folder), encoding="utf-8")
    console.print(f"Page: {path}", markup=False, soft_wrap=True)


def _bar() -> Progress:
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    return Progress(*columns, console=console)
