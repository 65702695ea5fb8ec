"""What comes with the package is what is worked out, and is taken for nothing else."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import pcm_gym
from pcm_gym.tasks import shipped
from tests.shipped.scenes import NAMES, scene_of, worked_out

# States are known to about this, dimensionless: rounding errors of Newton's method, larger near poles and folds.
ROUNDING = 1e-9


@pytest.mark.parametrize("name", NAMES)
def test_what_is_shipped_is_what_is_worked_out(name: str) -> None:
    """If it is not, `python -m tests.shipped` writes it again, and the changelog says why."""
    scene, made = scene_of(name), worked_out(name)
    home, roadmap = shipped.shipped_home(scene.mechanism), scene.roadmap
    assert home is not None
    assert shipped.shipped_roadmap(scene.mechanism, made.step, scene.reserve) is not None
    np.testing.assert_allclose(home.state, made.home.state, rtol=0.0, atol=ROUNDING)
    np.testing.assert_array_equal(home.inputs, made.home.inputs)
    np.testing.assert_array_equal(home.load, made.home.load)
    assert (roadmap.seeds, roadmap.least_margin) == (made.roadmap.seeds, made.roadmap.least_margin)
    for own in ("load", "inputs", "cells", "ways"):
        np.testing.assert_array_equal(getattr(roadmap, own), getattr(made.roadmap, own))
    np.testing.assert_array_equal(roadmap.raster.shape, made.roadmap.raster.shape)
    np.testing.assert_allclose(roadmap.states, made.roadmap.states, rtol=0.0, atol=ROUNDING)
    # a derivative, which grows towards folds
    np.testing.assert_allclose(roadmap.pose_densities, made.roadmap.pose_densities, rtol=1e-6, atol=ROUNDING)


@pytest.fixture
def scene() -> pcm_gym.Scene:
    return scene_of("2PFR")


def test_nothing_is_compiled_to_know_the_catalogues_scenes(
    scene: pcm_gym.Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pcm_gym.solving.home_equilibrium", None)
    monkeypatch.setattr("pcm_gym.tasks.scene.build_roadmap", None)
    other = replace(scene, margin=math.nextafter(scene.margin, 1.0))  # another one, of which nothing is remembered
    assert len(other.roadmap) > 0
    np.testing.assert_array_equal(other.home.inputs, scene.mechanism.home_inputs)


def test_what_is_shipped_holds_for_no_other_mechanism(scene: pcm_gym.Scene) -> None:
    mechanism = scene.mechanism
    first, *others = mechanism.legs
    limits = tuple(np.multiply(first.actuator.limits, 1.0 + 1e-9))
    changed = replace(first, actuator=replace(first.actuator, limits=limits))
    assert shipped.shipped_home(replace(mechanism, legs=(changed, *others))) is None
    assert shipped.shipped_home(replace(mechanism, home_inputs=tuple(scene.home.inputs + 1e-9))) is None
    assert shipped.shipped_home(replace(mechanism, home_pose=None)) is None
    assert shipped.shipped_home(replace(mechanism, name=f"../shipped/{mechanism.name}")) is None
    # another library's sine is the same number
    turned = replace(first, actuator=replace(first.actuator, clamp_angle=np.nextafter(first.actuator.clamp_angle, 9.0)))
    assert shipped.shipped_home(replace(mechanism, legs=(turned, *others))) is not None


def test_what_is_shipped_holds_for_no_other_scene(scene: pcm_gym.Scene) -> None:
    mechanism, step = scene.mechanism, scene.step
    assert shipped.shipped_roadmap(mechanism, 1.001 * step, scene.reserve) is None
    assert shipped.shipped_roadmap(mechanism, step, 1.001 * scene.reserve) is None
    assert scene._shipped_roadmap is not None
    assert replace(scene, load=(0.0, -0.01))._shipped_roadmap is None
    assert replace(scene, limits=("contact",))._shipped_roadmap is None
    assert replace(scene, origin=scene.home)._shipped_roadmap is None


@pytest.mark.parametrize("damage", ["no file", "empty", "cut", "changed", "other numbers", "other version"])
def test_what_cannot_be_read_is_worked_out(
    damage: str, scene: pcm_gym.Scene, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    path, content = tmp_path / "2PFR.npz", (shipped.FOLDER / "2PFR.npz").read_bytes()
    if damage == "other numbers":
        np.savez(path, home=np.zeros(3))
    elif damage == "other version":
        with np.load(shipped.FOLDER / "2PFR.npz") as archive:
            np.savez(path, **{**archive, "version": np.array(0)})
    elif damage != "no file":
        middle = len(content) // 2
        changed = content[:middle] + bytes([content[middle] ^ 0xFF]) + content[middle + 1 :]
        path.write_bytes({"empty": b"", "cut": content[:middle], "changed": changed}[damage])
    monkeypatch.setattr(shipped, "FOLDER", tmp_path)
    shipped._kept.cache_clear()
    assert shipped.shipped_home(scene.mechanism) is None
    assert shipped.shipped_roadmap(scene.mechanism, scene.step, scene.reserve) is None
    shipped._kept.cache_clear()
