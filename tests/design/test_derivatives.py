"""Derivatives by the design: against differences over designs, each solved anew, and against identities."""

import numpy as np
import pytest

import pcm_gym
from pcm_gym.arrays import Array
from pcm_gym.design.parameters import NAMES, checked_parameters

# Places and weights of a first difference of fourth order, times 12 widths.
STENCIL = ((-2.0, 1.0), (-1.0, -8.0), (1.0, 8.0), (2.0, -1.0))
LOADS = {"2RFR": (0.25, -0.5), "2PFR": (0.5, -0.25), "3PFR": (0.125, -0.25, 0.05)}


def loaded(name: str) -> pcm_gym.Equilibrium:
    """An equilibrium beside home, under a load."""
    mechanism = pcm_gym.get_mechanism(name)
    home, units = pcm_gym.home_equilibrium(mechanism), mechanism.units
    beside = home.inputs + 0.02 * np.arange(1, mechanism.leg_count + 1) * units.inputs
    return pcm_gym.BranchTracker(mechanism, home).step(beside, np.array(LOADS[name]) * units.load).equilibrium


def every_parameter(mechanism: pcm_gym.Mechanism) -> list[pcm_gym.DesignParameter]:
    found = []
    for leg in range(mechanism.leg_count):
        for name in NAMES:
            own = pcm_gym.DesignParameter(name, leg)
            try:
                checked_parameters(mechanism, [own])
            except ValueError:
                continue
            found.append(own)
    return found


def solved_anew(start: pcm_gym.Equilibrium, parameter: pcm_gym.DesignParameter, value: float) -> list[Array]:
    """What is known of the equilibrium of another design, out of the set of all of them, not followed to there."""
    mechanism = pcm_gym.change_design(start.mechanism, [parameter], [value])
    rho_max = 1.2 * max(rod.rho for rod in start.rods)
    found = pcm_gym.solve_forward(mechanism, start.inputs, start.load, rho_max)
    own = min(found, key=lambda each: float(np.abs(each.state - start.state).max()))
    return [own.pose, np.array([rod.force for rod in own.rods]), own.actuator_forces, np.array(own.stability_margin)]


def width_of(parameter: pcm_gym.DesignParameter, mechanism: pcm_gym.Mechanism) -> float:
    if parameter.is_positive:
        return 2e-4 * parameter.value(mechanism)
    return 2e-4 * (1.0 if parameter.name.endswith("angle") else mechanism.units.length)


@pytest.mark.parametrize("name", ["2RFR", "2PFR"])
def test_derivatives_are_differences_over_designs_that_are_solved_anew(name: str) -> None:
    start = loaded(name)
    parameters = every_parameter(start.mechanism)
    assert len(parameters) == {"2RFR": 10, "2PFR": 12}[name]
    told = pcm_gym.design_derivatives(start, parameters)
    for k, own in enumerate(parameters):
        value, width = own.value(start.mechanism), width_of(own, start.mechanism)
        differences = [np.zeros(shape) for shape in (2, (2, 2), 2, ())]
        for place, weight in STENCIL:
            for total, at in zip(differences, solved_anew(start, own, value + place * width), strict=True):
                total += weight * at / (12.0 * width)
        for part, expected in zip(
            (told.pose, told.rod_forces, told.actuator_forces, told.stability_margin), differences, strict=True
        ):
            scale = np.abs(part).max()
            assert part[..., k] == pytest.approx(expected, rel=1e-7, abs=1e-7 * scale), own


def test_derivatives_of_a_platform_are_differences_over_designs_that_are_followed() -> None:
    start = loaded("3PFR")
    parameters = every_parameter(start.mechanism)
    assert len(parameters) == 24
    told = pcm_gym.design_derivatives(start, parameters)
    for k, own in enumerate(parameters):
        value, width = own.value(start.mechanism), width_of(own, start.mechanism)
        pose, margin = np.zeros(3), 0.0
        for place, weight in STENCIL:
            there = pcm_gym.follow_design(start, pcm_gym.change_design(start.mechanism, [own], [value + place * width]))
            assert there.residual < 1e-11
            pose += weight * there.pose / (12.0 * width)
            margin += weight * there.stability_margin / (12.0 * width)
        assert told.pose[:, k] == pytest.approx(pose, rel=1e-7, abs=1e-7 * np.abs(told.pose).max()), own
        scale = np.abs(told.stability_margin).max()
        assert told.stability_margin[k] == pytest.approx(margin, rel=1e-7, abs=1e-7 * scale), own


@pytest.mark.parametrize("name", ["2RFR", "2PFR", "3PFR"])
def test_a_mechanism_that_is_moved_scaled_or_stiffened_as_a_whole_does_what_it_did(name: str) -> None:
    """All bases together move the pose; all lengths of an unloaded mechanism scale it; all stiffnesses the forces."""
    mechanism = pcm_gym.get_mechanism(name)
    home, legs = pcm_gym.home_equilibrium(mechanism), range(mechanism.leg_count)

    def by(*names: str) -> pcm_gym.DesignDerivatives:
        return pcm_gym.design_derivatives(home, [pcm_gym.DesignParameter(own, leg) for own in names for leg in legs])

    moved = by("base_x").pose.sum(axis=1)
    assert moved == pytest.approx(np.eye(mechanism.dof)[0], abs=1e-9)
    stiffnesses = np.array([leg.rod.bending_stiffness for leg in mechanism.legs])
    stiffened = by("bending_stiffness")
    assert stiffened.pose @ stiffnesses == pytest.approx(np.zeros(mechanism.dof), abs=1e-9 * mechanism.units.length)
    forces = np.array([rod.force for rod in home.rods])
    assert stiffened.rod_forces @ stiffnesses == pytest.approx(forces, rel=1e-8, abs=1e-10)
    assert stiffened.stability_margin @ stiffnesses == pytest.approx(home.stability_margin, rel=1e-8)


def test_turning_a_clamp_is_turning_its_motor() -> None:
    start = loaded("2RFR")
    turned = pcm_gym.design_derivatives(start, [pcm_gym.DesignParameter("clamp_angle", leg) for leg in range(2)])
    assert turned.pose == pytest.approx(start.forward_jacobian, rel=1e-12)


def test_an_equilibrium_follows_a_design_there_and_back() -> None:
    start = loaded("2RFR")
    parameters = [pcm_gym.DesignParameter("length", 0), pcm_gym.DesignParameter("base_y", 1)]
    values = np.array([own.value(start.mechanism) for own in parameters])
    other = pcm_gym.change_design(start.mechanism, parameters, values + 0.1 * start.mechanism.units.length)
    there = pcm_gym.follow_design(start, other)
    assert there.mechanism == other
    assert there.residual < 1e-12
    back = pcm_gym.follow_design(there, start.mechanism)
    assert back.pose == pytest.approx(start.pose, abs=1e-12)
    assert back.state == pytest.approx(start.state, rel=1e-10, abs=1e-12)


def test_a_design_in_which_the_equilibrium_has_ended_is_refused() -> None:
    """The bases farther apart than both rods are long."""
    start = loaded("2RFR")
    parameter, apart = pcm_gym.DesignParameter("base_x", 1), 3.0 * start.mechanism.units.length
    wide = pcm_gym.change_design(start.mechanism, [parameter], [parameter.value(start.mechanism) + apart])
    with pytest.raises(pcm_gym.DesignError, match="does not continue"):
        pcm_gym.follow_design(start, wide)


def test_derivatives_at_a_fold_are_refused() -> None:
    home = pcm_gym.home_equilibrium(pcm_gym.get_mechanism("2RFR"))
    parameter = pcm_gym.DesignParameter("length", 0)
    straight = pcm_gym.Equilibrium(home.mechanism, np.full_like(home.state, 1e6), home.inputs, home.load)
    with pytest.raises(np.linalg.LinAlgError, match="do not exist"):
        pcm_gym.design_derivatives(straight, [parameter])


@pytest.mark.parametrize(
    ("name", "leg", "message"),
    [
        ("width", 0, "name must be one of"),
        ("length", 3, "leg must be at most 2"),
        ("length", True, "leg must be a whole number"),
    ],
)
def test_parameters_that_do_not_exist_are_refused(name: str, leg: int, message: str) -> None:
    with pytest.raises((TypeError, ValueError), match=message):
        pcm_gym.DesignParameter(name, leg)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ([], "one at least"),
        ([("length", 0), ("length", 0)], "once each"),
        ([("length", 2)], "legs 0 to 1"),
        ([("axis_angle", 0)], "one of sliders"),
        ([("attachment_x", 1)], "one of platforms"),
    ],
)
def test_parameters_that_a_mechanism_lacks_are_refused(given: list[tuple[str, int]], message: str) -> None:
    parameters = [pcm_gym.DesignParameter(*own) for own in given]
    with pytest.raises(ValueError, match=message):
        pcm_gym.change_design(pcm_gym.get_mechanism("2RFR"), parameters, [1.0] * len(given))
