"""Wheel and sdist as users get them: built, looked into, and tried in a clean environment outside of the repository.

From the repository's root, with ``build`` and ``uv`` installed:

    python -m tests.packages                              # with the newest dependencies
    python -m tests.packages --resolution lowest-direct   # with the oldest ones that are allowed

It needs an index to install from, and compiles some kernels: some minutes.
"""

import argparse
import configparser
import email
import json
import os
import re
import subprocess
import sys
import tarfile
import tempfile
import zipfile
from collections.abc import Iterator, Mapping
from pathlib import Path

ROOT = Path(__file__).parents[2]
# Of the sdist's own tests those that need neither learning libraries nor long computations.
SDIST_TESTS = ("tests/mechanism", "tests/commands/test_start.py")


def run(*command: str | Path, cwd: Path, code: int = 0, environment: Mapping[str, str] = {}) -> str:
    """Run a command that must end with this code; return what it said."""
    clean = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "VIRTUAL_ENV")}
    ended = subprocess.run(
        [str(part) for part in command],
        cwd=cwd,
        env={**clean, **environment},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
    )
    assert ended.returncode == code, f"{command} ended with {ended.returncode}:\n{ended.stdout[-5000:]}"
    return ended.stdout


def complaints_of_wheel(wheel: Path) -> Iterator[str]:
    """What is wrong inside of a wheel."""
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
        info = next(name.partition("/")[0] for name in names if ".dist-info/" in name)
        for name in names:
            if name.partition("/")[0] not in ("pcm_gym", info):
                yield f"the wheel holds {name}"
        own = (path for ending in (".py", ".npz") for path in (ROOT / "pcm_gym").rglob(f"*{ending}"))
        sources = {path.relative_to(ROOT).as_posix() for path in own} | {"pcm_gym/py.typed"}
        for name in sources - set(names):
            yield f"the wheel lacks {name}"
        metadata = email.message_from_bytes(archive.read(f"{info}/METADATA"))
        entries = configparser.ConfigParser()
        entries.read_string(archive.read(f"{info}/entry_points.txt").decode())
    for link in re.findall(r"\]\((?!https?://|#)[^)]*\)", str(metadata.get_payload())):
        yield f"the description has a link that leads nowhere on an index page: {link}"
    if dict(entries["console_scripts"]) != {"pcm-gym": "pcm_gym.commands.app:main"}:
        yield f"the commands are {dict(entries['console_scripts'])}"


def complaints_of_sdist(sdist: Path) -> Iterator[str]:
    """What of the repository is not in an sdist."""
    tracked = run("git", "ls-files", cwd=ROOT).split("\n")
    with tarfile.open(sdist) as archive:
        held = {name.partition("/")[2] for name in archive.getnames()}
    for name in tracked:
        if name and name not in held:
            yield f"the sdist lacks {name}"


def try_wheel(wheel: Path, folder: Path, resolution: str) -> None:
    """Install a wheel alone and use it as its users do, from a folder that knows nothing of the repository."""
    python = make_environment(folder / "user", ROOT, resolution)
    run("uv", "pip", "install", "--python", python, "--no-deps", wheel, cwd=folder)
    command = python.parent / "pcm-gym"
    own = {"NUMBA_CACHE_DIR": str(folder / "kernels")}
    assert run(command, "--version", cwd=folder).strip() == wheel.name.split("-")[1]
    assert "2RFR" in run(command, "list", cwd=folder, environment=own)
    assert "nothing is compiled" in run(command, "doctor", cwd=folder, environment=own)
    found = run(python, "-W", "error", "-m", "pcm_gym", "fk", "2RFR", "--json", cwd=folder, environment=own)
    equilibria = json.loads(found[found.index("{\n") :])["equilibria"]
    assert len(equilibria) == 9, found
    assert abs(equilibria[0]["pose"][1] - 0.927501479) < 1e-8
    assert "all is well" in run(command, "doctor", cwd=folder, environment=own)
    refused = run(command, "render", "2RFR", "--out", "x.png", cwd=folder, code=1, environment=own)
    assert "pip install 'pcm_gym[render]'" in refused, refused
    assert "pip install -e '.[agents]'" in run(command, "train", "x.yaml", cwd=folder, code=1, environment=own)
    run(python, "-c", "import agents", cwd=folder, code=1)
    files = run(python, "-c", "import importlib.metadata as m; print(*m.files('pcm_gym'), sep='\\n')", cwd=folder)
    tops = {name.partition("/")[0] for name in files.split()}
    assert tops - {"..", "pcm_gym"} == {name for name in tops if name.endswith(".dist-info")}, tops


def try_sdist(sdist: Path, folder: Path, resolution: str) -> None:
    """Unpack an sdist, install it with what its tests need, and run some of them in it."""
    with tarfile.open(sdist) as archive:
        archive.extractall(folder / "source", filter="data")
    (source,) = (folder / "source").iterdir()
    python = make_environment(folder / "tester", source, resolution, "--extra", "render", "--extra", "test")
    run("uv", "pip", "install", "--python", python, "--no-deps", source, cwd=folder)
    own = {"NUMBA_CACHE_DIR": str(folder / "kernels")}
    said = run(python, "-m", "pytest", "-q", "-p", "no:cacheprovider", *SDIST_TESTS, cwd=source, environment=own)
    print(said.strip().splitlines()[-1])


def make_environment(folder: Path, project: Path, resolution: str, *extras: str) -> Path:
    """Return the interpreter of a new environment, with what a project and some of its extras need."""
    run("uv", "venv", "--python", sys.executable, folder, cwd=folder.parent)
    python = folder / "bin" / "python"
    needed: tuple[str | Path, ...] = ("--resolution", resolution, "-r", project / "pyproject.toml", *extras)
    run("uv", "pip", "install", "--python", python, *needed, cwd=folder.parent)
    return python


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--resolution", choices=("highest", "lowest-direct"), default="highest")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        run(sys.executable, "-m", "build", "--outdir", folder / "dist", ROOT, cwd=folder)
        (wheel,), (sdist,) = (folder / "dist").glob("*.whl"), (folder / "dist").glob("*.tar.gz")
        complaints = [*complaints_of_wheel(wheel), *complaints_of_sdist(sdist)]
        assert not complaints, "\n".join(complaints)
        print(f"{wheel.name} and {sdist.name} hold what they should")
        try_wheel(wheel, folder, arguments.resolution)
        print("the wheel works in a clean environment")
        try_sdist(sdist, folder, arguments.resolution)
        print("the sdist's tests pass in a clean environment")


if __name__ == "__main__":
    main()
