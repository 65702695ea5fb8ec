"""What the commands answer is what the library, and the outside numbers of the same problems, say."""

import math
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from PIL import Image

import pcm_gym
from tests.commands.calls import Shell
from tests.solving.test_outside_numbers import EQUILIBRIA

EI = pcm_gym.get_mechanism("2RFR").legs[0].rod.bending_stiffness  # whose length is 1 m


def test_list_names_all_there_is(shell: Shell) -> None:
    content = shell("list", "--json").content
    assert [own["id"] for own in content["environments"]] == pcm_gym.environment_ids()
    assert [own["name"] for own in content["mechanisms"]] == pcm_gym.mechanism_names()
    printed = shell("list").output
    assert all(name in printed for name in [*pcm_gym.environment_ids(), *content["tasks"]])


def test_info_tells_of_mechanisms_and_environments(shell: Shell) -> None:
    home = shell("info", "2RFR", "--json").content
    np.testing.assert_allclose(home["home_pose"], EQUILIBRIA[0][0], atol=1e-9)
    assert home["end_effector"] == "point"
    assert [leg["length"] for leg in home["legs"]] == [1.0, 1.0]
    own = shell("info", "PCM/2PFR-Switch-v0", "--json").content
    assert (own["mechanism"], own["task"], own["time_limit"]) == ("2PFR", "Switch", 150)
    assert len(own["observation"]) > len(own["goal"]) > 0
    for name in ("2RFR", "PCM/2RFR-Reach-v0"):
        assert shell("info", name).code == 0


def test_fk_finds_the_equilibria_that_others_have_found(shell: Shell) -> None:
    found = shell("fk", "2RFR", "--inputs", "120deg,60deg", "--rho-max", "7.2", "--json").content["equilibria"]
    assert len(found) == len(EQUILIBRIA)
    for tip, force, modes, index in EQUILIBRIA:
        own = min(found, key=lambda each: math.dist(each["pose"], tip))
        np.testing.assert_allclose(own["pose"], tip, atol=1e-9)
        assert math.hypot(*own["rods"][0]["force"]) == pytest.approx(force * EI, abs=1e-6)
        assert sorted(rod["mode"] for rod in own["rods"]) == sorted(modes)
        assert own["index"] == index
        assert own["is_stable"] == (index == 0)


def test_fk_keeps_the_numbers_of_those_that_are_left_out(shell: Shell) -> None:
    everything = shell("fk", "2RFR", "--json").content["equilibria"]
    stable = shell("fk", "2RFR", "--stable", "--json").content["equilibria"]
    assert stable == [each for each in everything if each["is_stable"]]
    assert [each["number"] for each in everything] == list(range(len(everything)))


def test_ik_finds_the_inputs_that_others_have_found(shell: Shell) -> None:
    found = shell("ik", "2RFR", "--pose", "0.3,0.7", "--json").content["equilibria"]
    errors = [np.abs(np.degrees(each["inputs"]) - [131.59066, -22.99029]).max() for each in found]
    assert min(errors) < 5e-6


@pytest.mark.parametrize("inputs", ["-0.5,0.3", "=-0.5,0.3", "=-0.5 0.3"])
def test_negative_numbers_are_no_options(shell: Shell, inputs: str) -> None:
    option = [f"--inputs{inputs}"] if inputs.startswith("=") else ["--inputs", inputs]
    found = shell("fk", "2RFR", *option, "--json").content["equilibria"]
    assert {tuple(each["inputs"]) for each in found} == {(-0.5, 0.3)}


def test_sets_without_members_are_an_answer(shell: Shell) -> None:
    ended = shell("ik", "2RFR", "--pose", "5,5", "--json")
    assert (ended.code, ended.content["equilibria"]) == (0, [])
    assert ended.content["reason"]
    assert ended.content["reason"] in shell("ik", "2RFR", "--pose", "5,5").output


def test_track_meets_the_fold_that_the_library_meets(shell: Shell) -> None:
    mechanism = pcm_gym.get_mechanism("2RFR")
    home = pcm_gym.home_equilibrium(mechanism)
    target = np.array([0.3, 6.0])
    expected = pcm_gym.BranchTracker(mechanism, home).step(target)
    content = shell("track", "2RFR", f"--to={target[0]},{target[1]}", "--to=0,0", "--json").content
    assert len(content["steps"]) == 1  # none after the end of the branch
    step = content["steps"][0]
    assert (step["event"], step["fraction"]) == (str(expected.event), expected.fraction)
    assert step["equilibrium"]["pose"] == expected.equilibrium.pose.tolist()
    assert shell("track", "2RFR", f"--to={target[0]},{target[1]}").code == 0


def test_track_proves_its_way(shell: Shell) -> None:
    steps = shell("track", "2RFR", "--to=2.1,1.1", "--to=2.2,1.1", "--certify", "--json").content["steps"]
    assert [(step["event"], step["certificate"]) for step in steps] == [("none", "proved")] * 2


def test_plans_lead_to_the_goal_on_stable_equilibria(shell: Shell) -> None:
    content = shell("plan", "2RFR", "--pose", "0.3,0.7", "--json").content
    np.testing.assert_allclose(content["equilibria"][-1]["pose"], [0.3, 0.7], atol=1e-9)
    assert all(each["is_stable"] for each in content["equilibria"])
    assert np.abs(np.diff(content["inputs"], axis=0)).max() <= 0.1 + 1e-12
    both = shell("plan", "2RFR", "--to", "2.3,1.2", "--step", "0.05,0.05", "--json").content
    np.testing.assert_allclose(both["inputs"][-1], [2.3, 1.2], atol=1e-12)
    assert both["length"] == len(both["inputs"]) - 1
    assert "steps" in shell("plan", "2RFR", "--to", "2.3,1.2").output


def test_fold_is_the_nearest_one(shell: Shell) -> None:
    expected = pcm_gym.nearest_fold(pcm_gym.home_equilibrium(pcm_gym.get_mechanism("2RFR")))
    assert expected is not None
    content = shell("fold", "2RFR", "--json").content
    assert content["fold"]["distance"] == expected.distance
    assert "fold" in shell("fold", "2RFR").output
    assert shell("fold", "2RFR", "--reach", "0.01", "--json").content["fold"] is None


def test_snap_falls_from_the_fold_on_a_way_and_from_what_is_unstable(shell: Shell) -> None:
    for arguments in (["--to=0.3,6"], ["--number", "2"]):
        content = shell("snap", "2RFR", *arguments, "--json").content
        assert content["status"] == "landed"
        assert content["landing"]["is_stable"]
        assert content["energy_released"] == pytest.approx(content["from"]["energy"] - content["landing"]["energy"])
    assert "rest" in shell("snap", "2RFR", "--to=0.3,6").output


def test_snap_says_where_nothing_falls(shell: Shell) -> None:
    """At the fold that is nearest to the home of the 2RFR no small disturbance lowers the energy."""
    content = shell("snap", "2RFR", "--json").content
    assert content["status"] == "stayed"
    assert content["landing"] is None
    assert "No small disturbance" in shell("snap", "2RFR").output


def test_loads_bear(shell: Shell) -> None:
    found = shell("fk", "2RFR", "--load=0,-0.05", "--json").content["equilibria"]
    assert all(each["load"] == [0.0, -0.05] for each in found)


def test_atlas_is_charted_and_kept(shell: Shell, tmp_path: Path) -> None:
    path = tmp_path / "own.npz"
    coarse = ["--pitch", "0.1", "--input-cells", "6", "--seed-nodes", "1"]
    content = shell("atlas", "2PFR", *coarse, "--out", path, "--json").content
    kept = pcm_gym.load_atlas(path)
    assert len(content["branches"]) == len(kept.branches)
    assert sum(branch["contains_home"] for branch in content["branches"]) == 1
    assert str(path) in shell("atlas", "2PFR", *coarse, "--out", path).output


def test_mechanisms_come_from_files(shell: Shell, tmp_path: Path) -> None:
    expected = shell("fk", "2RFR", "--json").content
    for name in ("own.json", "own.yaml"):
        pcm_gym.save_mechanism(pcm_gym.get_mechanism("2RFR"), tmp_path / name)
        assert shell("fk", tmp_path / name, "--json").content == expected
        assert shell("info", tmp_path / name).code == 0


@pytest.mark.parametrize(
    ("arguments", "frames"),
    [
        (["2RFR", "--ghosts"], 1),
        (["2RFR", "--number", "2"], 1),
        (["2RFR", "--to=3,3", "--frames", "4"], 5),
        (["PCM/2RFR-Reach-v0", "--frames", "3"], 4),
        (["PCM/2RFR-Reach-v0", "--frames", "2", "--actions", "still", "--seed", "3"], 3),
    ],
)
def test_pictures_are_drawn(shell: Shell, tmp_path: Path, arguments: list[str], frames: int) -> None:
    for ending, expected in ((".png", 1), (".gif", frames)):
        path = tmp_path / f"own{ending}"
        ended = shell("render", *arguments, "--out", path, "--size", "128")
        assert (ended.code, str(path) in ended.output) == (0, True), ended.errors
        with Image.open(path) as image:
            assert getattr(image, "n_frames", 1) <= expected
            assert (
                expected == 1 or "still" in arguments or getattr(image, "n_frames", 1) > 1
            )  # equal ones are kept as one
            assert len(np.unique(np.asarray(image.convert("RGB")).reshape(-1, 3), axis=0)) > 5


def test_motions_show_where_the_mechanism_falls(shell: Shell, tmp_path: Path) -> None:
    path = tmp_path / "fall.gif"
    assert shell("render", "2RFR", "--to=0.3,6", "--frames", "3", "--out", path, "--size", "128").code == 0
    with Image.open(path) as image:
        assert image.n_frames >= 3  # type: ignore[attr-defined]


def test_drawings_in_lines_show_the_rods_where_they_are(shell: Shell, tmp_path: Path) -> None:
    path = tmp_path / "own.svg"
    for name, rods in (("2RFR", 2), ("3PFR", 3)):
        assert shell("render", name, "--out", path, "--size", "300").code == 0
        root = ElementTree.parse(path).getroot()
        assert root.get("width") == "300"
        lines = [line.get("points", "").split() for line in root.iter("{http://www.w3.org/2000/svg}polyline")]
        long = [points for points in lines if len(points) == 200]
        assert len(long) == rods
        if rods == 2:  # whose tips meet
            tips = [[float(number) for number in points[-1].split(",")] for points in long]
            assert math.dist(*tips) < 0.02


def test_interruption_and_unknown_mistakes_have_codes_of_their_own(
    shell: Shell, monkeypatch: pytest.MonkeyPatch
) -> None:
    for error, code in ((KeyboardInterrupt(), 130), (ZeroDivisionError("odd"), 70), (MemoryError(), 1)):

        def fail(*_: object, error: BaseException = error, **__: object) -> None:
            raise error

        monkeypatch.setattr(pcm_gym, "solve_forward", fail)
        ended = shell("fk", "2RFR")
        assert ended.code == code
        assert ended.errors or code == 130


def test_diagram_tells_the_folds_that_tracking_meets(shell: Shell, tmp_path: Path) -> None:
    line = ("diagram", "2RFR", "--inputs", "120deg,60deg", "--to", "206deg,100deg")
    told = shell(*line, "--slices", 6, "--json").content
    folds = [point for point in told["points"] if sorted(point["indices"]) == [0, 1]]
    assert folds
    assert all(point["kind"] == "fold" for point in told["points"])
    mechanism = pcm_gym.get_mechanism("2RFR")
    first, last = np.radians([[120.0, 60.0], [206.0, 100.0]])
    events = []
    for start in pcm_gym.solve_forward(mechanism, first).stable:
        step = pcm_gym.BranchTracker(mechanism, start).step(last)
        if step.event == pcm_gym.Event.FOLD:
            events.append(step.fraction)
    for start in pcm_gym.solve_forward(mechanism, last).stable:
        step = pcm_gym.BranchTracker(mechanism, start).step(first)
        if step.event == pcm_gym.Event.FOLD:
            events.append(1.0 - step.fraction)
    np.testing.assert_allclose(sorted(point["fraction"] for point in folds), sorted(events), atol=1e-7)
    shown = shell(*line, "--slices", 6, "--out", tmp_path / "diagram.svg", "--ordinate", "y")
    assert f"{len(told['branches'])} branches" in shown.output
    root = ElementTree.parse(tmp_path / "diagram.svg").getroot()
    marks = [element for element in root.iter() if element.tag.endswith("circle")]
    assert len(marks) == len(told["points"])
