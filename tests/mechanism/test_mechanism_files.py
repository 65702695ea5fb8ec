"""Mechanisms in files: what is written comes back to the last digit, and the published schema says what may be."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import pcm_gym
from pcm_gym.mechanism.schema import data_from_mechanism, mechanism_from_text, mechanism_schema
from tests.reference.mechanisms import FAMILIES, random_mechanism

ROOT = Path(__file__).parents[2]
ENDINGS = (".json", ".yaml", ".yml", ".JSON")


@pytest.mark.parametrize("ending", ENDINGS)
@pytest.mark.parametrize("family", FAMILIES)
def test_random_mechanisms_come_back_to_the_last_digit(tmp_path: Path, family: str, ending: str) -> None:
    numbers = np.random.default_rng(11)
    for _ in range(5):
        mechanism = random_mechanism(family, numbers)
        pcm_gym.save_mechanism(mechanism, tmp_path / f"own{ending}")
        assert pcm_gym.load_mechanism(tmp_path / f"own{ending}") == mechanism


@pytest.mark.parametrize("ending", ENDINGS[:2])
def test_any_double_comes_back(tmp_path: Path, ending: str) -> None:
    numbers = np.random.default_rng(12)
    sizes = 10.0 ** numbers.uniform(-6.0, 6.0, 200)
    for length, clamp_angle in zip(sizes, numbers.uniform(-4.0, 4.0, 200) * sizes[::-1], strict=True):
        rod = pcm_gym.Rod(length, 3e-5)
        motors = [pcm_gym.Revolute((x, 5e-324), clamp_angle, (-1e17, 1.0)) for x in (-0.25, 0.25)]
        mechanism = pcm_gym.Mechanism("é: [1]", tuple(pcm_gym.Leg(motor, rod) for motor in motors), (0.0, -0.0))
        pcm_gym.save_mechanism(mechanism, tmp_path / f"own{ending}")
        assert pcm_gym.load_mechanism(tmp_path / f"own{ending}") == mechanism


@pytest.mark.parametrize("ending", ENDINGS[:2])
def test_rods_of_something_come_back_to_the_last_digit(tmp_path: Path, ending: str) -> None:
    numbers, own = np.random.default_rng(13), pcm_gym.get_mechanism("2RFR")
    for size in numbers.uniform(1e-4, 1e-2, 50).tolist():
        material = pcm_gym.Material(*(10.0 ** numbers.uniform(3.0, 11.0, 3)).tolist())
        sections = pcm_gym.Round(size), pcm_gym.Strip(3.0 * size, size)
        rods = [pcm_gym.Rod(1.0, section=section, material=material) for section in sections]
        legs = tuple(pcm_gym.Leg(leg.actuator, rod) for leg, rod in zip(own.legs, rods, strict=True))
        mechanism = pcm_gym.Mechanism("of something", legs, reference=rods[0])
        pcm_gym.save_mechanism(mechanism, tmp_path / f"own{ending}")
        again = pcm_gym.load_mechanism(tmp_path / f"own{ending}")
        assert again == mechanism
        assert [leg.rod.section for leg in again.legs] == list(sections)
        assert again.legs[1].rod.material == material


@pytest.mark.parametrize("name", ["SPRING_STEEL", "NITINOL", "FIBREGLASS"])
def test_materials_have_names(name: str) -> None:
    rod = {"length": 2, "section": {"kind": "strip", "width": 0.02, "thickness": 0.001}, "material": name}
    legs = [{"actuator": {"kind": "revolute", "base": [x, 0]}, "rod": rod} for x in (-0.25, 0.25)]
    made = mechanism_from_text(json.dumps({"name": "named", "legs": legs})).legs[0].rod
    assert made == pcm_gym.Rod(2.0, section=pcm_gym.Strip(0.02, 0.001), material=getattr(pcm_gym, name))


def test_names_that_yaml_would_read_as_something_else_come_back(tmp_path: Path) -> None:
    for name in ("yes", "1", "null", "2020-01-01", "~", "a: b", "#", "\ttab", "'"):
        own = pcm_gym.get_mechanism("2RFR")
        mechanism = pcm_gym.Mechanism(name, own.legs, own.home_inputs)
        pcm_gym.save_mechanism(mechanism, tmp_path / "own.yaml")
        assert pcm_gym.load_mechanism(tmp_path / "own.yaml") == mechanism


def test_what_has_a_default_may_be_left_out() -> None:
    motors = [{"kind": "revolute", "base": [x, 0]} for x in (-0.25, 0.25)]
    legs = [{"actuator": motor, "rod": {"length": 1, "bending_stiffness": 2.5}} for motor in motors]
    mechanism = mechanism_from_text(json.dumps({"name": "short", "legs": legs}))
    rod = pcm_gym.Rod(1.0, 2.5)
    expected = tuple(pcm_gym.Leg(pcm_gym.Revolute((x, 0.0)), rod) for x in (-0.25, 0.25))
    assert mechanism == pcm_gym.Mechanism("short", expected)


def wrong_contents() -> dict[str, tuple[Any, str]]:
    """Contents of which one entry is wrong, and the place that the refusal must name."""
    found: dict[str, tuple[Any, str]] = {}
    changes: dict[tuple[Any, ...], list[Any]] = {
        ("name",): ["", 3, None, True],
        ("legs",): [[], {}, None, "2"],
        ("legs", 0, "actuator"): [{}, None, {"kind": "screw"}, {"kind": "revolute"}],
        ("legs", 0, "actuator", "base"): [[0.0], [0.0, 1.0, 2.0], ["0", "1"], [None, 0.0], 3.0],
        ("legs", 0, "actuator", "limits"): [[0.0], "x", None, [1.0, -1.0]],
        ("legs", 1, "rod"): [None, {}, {"length": 1.0}],
        ("legs", 1, "rod", "length"): ["1.0", 0.0, -1.0, True, [1.0], None],
        ("legs", 1, "rod", "bending_stiffness"): [0, "1e-3"],
        ("legs", 1, "rod", "section"): [
            {"kind": "tube"},
            {"kind": "round", "radius": 0.0},
            {"kind": "round", "radius": 1},
        ],
        ("legs", 1, "rod", "material"): ["WOOD", {"modulus": 1.0}, "NITINOL"],
        ("home_inputs",): ["0,0", [None, 0.0], 3.0],
        ("description",): [None, 3],
        ("colour",): ["red"],
    }
    for place, values in changes.items():
        for value in values:
            content = json.loads(json.dumps(data_from_mechanism(pcm_gym.get_mechanism("2RFR"))))
            inner = content
            for key in place[:-1]:
                inner = inner[key]
            inner[place[-1]] = value
            name = "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in place).lstrip(".")
            found[f"{name} = {value!r}"] = (content, name.partition("]")[0])
    return found


@pytest.mark.parametrize("name", wrong_contents())
def test_wrong_entries_are_named(tmp_path: Path, name: str) -> None:
    content, place = wrong_contents()[name]
    for path, text in ((tmp_path / "a.json", json.dumps(content)), (tmp_path / "a.yaml", yaml.safe_dump(content))):
        path.write_text(text)
        with pytest.raises(pcm_gym.MechanismFileError) as refused:
            pcm_gym.load_mechanism(path)
        assert str(path) in str(refused.value)
        assert place in str(refused.value)
        assert len(str(refused.value)) < 1500


def test_entries_that_do_not_fit_together_are_refused_by_the_mechanism(tmp_path: Path) -> None:
    content = json.loads(json.dumps(data_from_mechanism(pcm_gym.get_mechanism("2RFR"))))
    content["home_inputs"] = [1.0]
    (tmp_path / "a.json").write_text(json.dumps(content))
    with pytest.raises(pcm_gym.MechanismFileError, match="home_inputs must have shape"):
        pcm_gym.load_mechanism(tmp_path / "a.json")


@pytest.mark.parametrize("path", ["own", "own.txt", "own.json.gz"])
def test_other_endings_are_refused(tmp_path: Path, path: str) -> None:
    with pytest.raises(ValueError, match=r"\.json"):
        pcm_gym.save_mechanism(pcm_gym.get_mechanism("2RFR"), tmp_path / path)
    with pytest.raises(pcm_gym.MechanismFileError, match=r"\.json"):
        pcm_gym.load_mechanism(tmp_path / path)


def test_what_is_no_file_is_said_so(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"own\.json cannot be read") as refused:
        pcm_gym.load_mechanism(tmp_path / "own.json")
    assert isinstance(refused.value, pcm_gym.MechanismFileError)
    (tmp_path / "folder.yaml").mkdir()
    with pytest.raises(pcm_gym.MechanismFileError, match="cannot be read"):
        pcm_gym.load_mechanism(tmp_path / "folder.yaml")


def test_published_schema_is_that_of_the_reader() -> None:
    """Made by ``pcm-gym schema > docs/mechanism.schema.json``."""
    published = json.loads((ROOT / "docs" / "mechanism.schema.json").read_text(encoding="utf-8"))
    assert published == json.loads(json.dumps(mechanism_schema()))
