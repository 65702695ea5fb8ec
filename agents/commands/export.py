"""The command that makes a policy of plain numbers out of a trained model."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from agents.commands.errors import errors_in_words, warn_of_foreign
from agents.experiments.runs import POLICY, find_trained

console = Console()


def export(
    trained: Annotated[
        Path, typer.Argument(metavar="RUN_OR_MODEL", help="Folder of a run or of a checkpoint, or a model.zip.")
    ],
    output: Annotated[
        Path | None, typer.Option(help=f"File to write, ending in .npz; {POLICY} beside the model by default.")
    ] = None,
    onnx: Annotated[bool, typer.Option("--onnx", help="Write an ONNX model beside it, ending in .onnx.")] = False,
) -> None:
    """Write a trained agent as a policy that `pcm_gym.load_policy` reads: NumPy only, no torch, no pickles."""
    with errors_in_words(console):
        from agents.experiments.export import exported  # loaded here because it loads torch, which --help does without

        files = find_trained(trained)
        warn_of_foreign(console, files.pickles)
        path = output or files.folder / POLICY
        policy = exported(files)
        policy.save(path)
        if onnx:
            policy.save_onnx(path.with_suffix(".onnx"))
        console.print(f'Policy: {path}. Use it with: pcm_gym.load_policy("{path}")', markup=False, soft_wrap=True)
