"""Whatever is wrong with a call is said in a sentence on standard error, with an exit code that says of what kind."""

import sys
from pathlib import Path

import pytest

import pcm_gym
from pcm_gym.commands import checkout
from tests.commands.calls import Shell

REFUSED, WRONG_USE = 1, 2

CALLS: list[tuple[str, int, tuple[str, ...]]] = [
    ("nothing", WRONG_USE, ("nothing",)),
    ("fk", WRONG_USE, ("MECHANISM",)),
    ("fk 2RFR --inputs", WRONG_USE, ("--inputs",)),
    ("fk 2RFR --lood=1,2", WRONG_USE, ("--lood",)),
    ("fk 2RFR --inputs=a,b", WRONG_USE, ("--inputs", "'a' is no number")),
    ("fk 2RFR --inputs=1,nan", WRONG_USE, ("nan", "not finite")),
    ("fk 2RFR --inputs=1e999,1", WRONG_USE, ("1e999", "not finite")),
    ("fk 2RFR --inputs=1,2deg3", WRONG_USE, ("2deg3",)),
    ("fk 2RFR --inputs=1", REFUSED, ("inputs", "(2,)")),
    ("fk 2RFR --inputs=", REFUSED, ("inputs", "(2,)")),
    ("fk 2RFR --inputs=1,2,3", REFUSED, ("inputs", "(2,)")),
    ("fk 2RFR --load=1", REFUSED, ("load", "(2,)")),
    ("fk 2RFR --rho-max=-1", REFUSED, ("rho_max",)),
    ("fk 2RFR --rho-max=nan", REFUSED, ("rho_max",)),
    ("fk 2RFR --rho-max=31", REFUSED, ("rho_max", "30")),
    ("fk 2RFR --rho-max=x", WRONG_USE, ("--rho-max", "x")),
    ("fk 3PFR --rho-max=4 --certify", REFUSED, ("two legs",)),
    ("fk 4RFR", REFUSED, ("4RFR", "2RFR, 2PFR, 3PFR", ".json")),
    ("fk nowhere.json", REFUSED, ("nowhere.json", "No such file")),
    ("fk nowhere.yaml", REFUSED, ("nowhere.yaml", "No such file")),
    ("ik 2RFR", WRONG_USE, ("--pose",)),
    ("ik 2RFR --pose=1", REFUSED, ("pose", "(2,)")),
    ("track 2RFR", WRONG_USE, ("--to",)),
    ("track 2RFR --to=1", REFUSED, ("inputs", "(2,)")),
    ("track 2RFR --to=1,2 --number=99", REFUSED, ("99", "there are 9")),
    ("track 2RFR --to=1,2 --number=-1", WRONG_USE, ("--number",)),
    ("track 2RFR --to=1,2 --inputs=5,4", REFUSED, ("branch of home ends", "--number")),
    ("plan 2RFR", WRONG_USE, ("--pose", "--to")),
    ("plan 2RFR --pose=0.3", REFUSED, ("pose", "(2,)")),
    ("plan 2RFR --pose=3,3", REFUSED, ("no motion", "no equilibrium at the goal")),
    ("plan 2RFR --to=1,1 --step=0,0", REFUSED, ("step",)),
    ("fold 2RFR --reach=0", REFUSED, ("reach",)),
    ("snap 2RFR --to=2.1,1.1", REFUSED, ("nothing to snap from",)),
    ("snap 2RFR --number=0 --inputs=x", WRONG_USE, ("--inputs",)),
    ("atlas 2RFR --pitch=0", REFUSED, ("pitch",)),
    ("atlas 2RFR --orientation=1", REFUSED, ("orientation",)),
    ("info", WRONG_USE, ("ID",)),
    ("info PCM/2RFR-Reech-v0", REFUSED, ("PCM/2RFR-Reech-v0", "did you mean PCM/2RFR-Reach-v0?")),
    ("info Nobody/Knows-v0", REFUSED, ("Nobody/Knows-v0", "`pcm-gym list`")),
    ("info no_such_module:PCM/2RFR-Reach-v0", REFUSED, ("no_such_module",)),
    ("info phys2d/CartPole-v1", REFUSED, ("phys2d/CartPole-v1", "no environment of a mechanism")),
    ("render 2RFR", WRONG_USE, ("--out",)),
    ("render 2RFR --out=x", REFUSED, (".png, .gif, .svg",)),
    ("render 2RFR --out=x.jpg", REFUSED, (".png, .gif, .svg",)),
    ("render 2RFR --out=x.png --size=9", WRONG_USE, ("--size",)),
    ("render 2RFR --out=no/such/folder/x.png", REFUSED, ("no/such/folder/x.png",)),
    ("render 2RFR --out=no/such/folder/x.svg", REFUSED, ("no/such/folder/x.svg",)),
    ("render 2RFR --out=x.svg --to=1,2", REFUSED, (".gif",)),
    ("render PCM/2RFR-Reach-v0 --out=x.svg", REFUSED, (".gif or a .png",)),
    ("render PCM/2RFR-Reach-v0 --out=x.png --inputs=1,2", REFUSED, ("--inputs",)),
    ("render PCM/2RFR-Reach-v0 --out=x.gif --actions=wild", WRONG_USE, ("wild",)),
    ("render PCM/2RFR-Reach-v0 --out=x.gif --frames=0", WRONG_USE, ("--frames",)),
    ("cache --sweep", WRONG_USE, ("--sweep",)),
    ("train", WRONG_USE, ("train --help",)),
    ("train nowhere.yaml", REFUSED, ("nowhere.yaml",)),
    ("evaluate nowhere", REFUSED, ("nowhere",)),
    ("figures --only=99", WRONG_USE, ("99",)),
]


@pytest.mark.parametrize(("call", "code", "words"), CALLS, ids=[call for call, *_ in CALLS])
def test_wrong_calls_are_refused_in_a_sentence(
    shell: Shell, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, call: str, code: int, words: tuple[str, ...]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "1000")
    ended = shell(*call.split())
    said = ended.errors + (ended.output if call.split()[0] in ("train", "evaluate") else "")
    assert ended.code == code, said
    for word in words:
        assert word in said
    assert not list(tmp_path.iterdir())


WRONG_FILES: dict[str, bytes] = {
    "empty.json": b"",
    "list.json": b"[]",
    "binary.json": b"\xff\xfe\x00",
    "deep.json": b"[" * 100_000,
    "large.json": b" " * (1 << 16) + b"{}",
    "inf.json": b'{"name": "x", "legs": 1e999}',
    "text.yaml": b"just text",
    "tab.yaml": b"\tname: x",
    "deep.yaml": b"[" * 3_000,
    "bomb.yaml": b"a: &a [x, x]\nb: &b [*a, *a]\nlegs: [*b, *b]",
    "object.yaml": b"!!python/object/apply:os.system [ls]",
    "date.yaml": b"name: 2020-01-01",
    "folder.yaml": b"",
}


@pytest.mark.parametrize("name", WRONG_FILES)
def test_files_without_a_mechanism_are_refused_in_a_sentence(shell: Shell, tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    if name.startswith("folder"):
        path.mkdir()
    else:
        path.write_bytes(WRONG_FILES[name])
    ended = shell("fk", path)
    assert ended.code == REFUSED
    assert str(path) in ended.errors
    assert len(ended.errors) < 1000


def test_what_is_missing_is_named_with_what_installs_it(
    shell: Shell, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    for name in [
        name for name in sys.modules if name.partition(".")[0] == "PIL" or name.startswith("pcm_gym.rendering")
    ]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "PIL", None)
    monkeypatch.delattr(pcm_gym, "rendering", raising=False)
    ended = shell("render", "2RFR", "--out", tmp_path / "x.png")
    assert ended.code == REFUSED
    assert "pip install 'pcm_gym[render]'" in ended.errors


@pytest.mark.parametrize("name", [command.name for command in checkout.COMMANDS])
def test_without_a_checkout_its_commands_say_what_to_do(
    shell: Shell, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, name: str
) -> None:
    monkeypatch.setattr(checkout, "_CHECKOUT", tmp_path)
    for arguments in ([], ["--help"], ["x", "--json"]):
        ended = shell(name, *arguments)
        assert ended.code == REFUSED
        assert "pip install -e '.[agents]'" in ended.errors


def test_foreign_agents_are_not_run(shell: Shell, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Another distribution has a top-level package of that name, too."""
    for name in [name for name in sys.modules if name.partition(".")[0] == "agents"]:
        monkeypatch.delitem(sys.modules, name)
    foreign = tmp_path / "agents"
    foreign.mkdir()
    (foreign / "__init__.py").write_text("raise RuntimeError('this must not run')")
    monkeypatch.syspath_prepend(tmp_path)
    ended = shell("train", "x.yaml")
    assert ended.code == REFUSED
    assert str(foreign) in ended.errors


def test_every_command_of_the_agents_is_one_of_the_checkout() -> None:
    from agents.commands.app import app

    names = {command.name or command.callback.__name__ for command in app.registered_commands if command.callback}
    assert names == {own.name for own in checkout.COMMANDS if own.module == "agents.commands.app"}


def test_explore_says_what_to_install(shell: Shell, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "websockets", None)
    monkeypatch.delitem(sys.modules, "pcm_gym.explorer.server", raising=False)
    for name in [name for name in sys.modules if name.startswith("websockets.")]:
        monkeypatch.delitem(sys.modules, name)
    ended = shell("explore", "--no-browser")
    assert ended.code == 1
    assert "pcm_gym[explore]" in ended.errors


def test_diagram_needs_an_end_and_a_picture_that_it_can_draw(shell: Shell) -> None:
    assert shell("diagram", "2RFR").code == 2
    assert shell("diagram", "2RFR", "--to", "1,1", "--out", "diagram.png").code == 1
