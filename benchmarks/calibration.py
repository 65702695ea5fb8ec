"""Calibration on synthetic measurements: how often are parameters within three standard errors?"""

from typing import Annotated

import numpy as np
import typer
from numpy.random import Generator
from rich.console import Console
from rich.progress import track
from rich.table import Table

import pcm_gym
from pcm_gym.arrays import Array
from pcm_gym.solving import BranchTracker, Event

# What is estimated: by how much it differs from the drawing, by parts, or by lengths and rad.
PARAMETERS = {
    "2RFR": (("length", 0), ("length", 1), ("clamp_angle", 1), ("base_x", 0), ("bending_stiffness", 0)),
    "2PFR": (("length", 0), ("axis_angle", 1), ("clamp_angle", 0), ("bending_stiffness", 0)),
    "3PFR": (("length", 0), ("clamp_angle", 1), ("attachment_x", 2), ("base_y", 1), ("bending_stiffness", 2)),
}
_DIFFERENCE = 0.02
# Standard deviation of what is measured, in mean rod lengths and rad.
_DEVIATION = 5e-4
_MEASUREMENTS = 30
# How far from home it is measured, in rad and mean rod lengths.
_REACH = {"2RFR": 0.5, "2PFR": 0.15, "3PFR": 0.15}


def calibration(
    trials: Annotated[int, typer.Option(min=1, help="Of each mechanism.")] = 200,
    mechanisms: Annotated[list[str] | None, typer.Option("--mechanism", help="Only these; all by default.")] = None,
    seed: Annotated[int, typer.Option()] = 0,
) -> None:
    """Calibrate designs on synthetic measurements, deviations unknown; some minutes.

    The exit status is 1 if fewer than 95 % of the parameters are within three standard errors.
    """
    table = Table("mechanism", "parameters", "trials", "within 3 errors", "rms of errors", title="Calibration")
    least = 1.0
    for name in mechanisms or list(PARAMETERS):
        generator = np.random.default_rng(seed)
        ratios = np.array([ratios_of(name, generator) for _ in track(range(trials), description=name, transient=True)])
        within = float((np.abs(ratios) < 3.0).mean())
        least = min(least, within)
        root = np.sqrt(np.square(ratios).mean())
        table.add_row(name, f"{ratios.shape[1]}", f"{trials}", f"{100.0 * within:.1f} %", f"{root:.2f}")
    Console().print(table)
    if least < 0.95:
        raise typer.Exit(1)


def ratios_of(name: str, generator: Generator) -> Array:
    """Return the errors of the estimates of one random design, over their standard errors, (m,)."""
    nominal = pcm_gym.get_mechanism(name)
    parameters = [pcm_gym.DesignParameter(*own) for own in PARAMETERS[name]]
    drawn = np.array([own.value(nominal) for own in parameters])
    sizes = [
        value if own.is_positive else (1.0 if own.name.endswith("angle") else nominal.units.length)
        for own, value in zip(parameters, drawn.tolist(), strict=True)
    ]
    values = drawn + generator.uniform(-_DIFFERENCE, _DIFFERENCE, len(drawn)) * sizes
    built = pcm_gym.change_design(nominal, parameters, values)
    found = pcm_gym.calibrate(nominal, _measured(built, nominal, generator), parameters)
    ratios: Array = (found.values - values) / found.standard_errors
    return ratios


def _measured(built: pcm_gym.Mechanism, nominal: pcm_gym.Mechanism, generator: Generator) -> pcm_gym.Measurements:
    """Return poses of a mechanism at inputs that it and the nominal one reach in a row without a fall."""
    units, both = nominal.units, [pcm_gym.home_equilibrium(own) for own in (built, nominal)]
    home = both[0].inputs
    inputs: list[Array] = []
    poses: list[Array] = []
    while len(inputs) < _MEASUREMENTS:
        away = generator.uniform(-1.0, 1.0, nominal.leg_count) * _REACH[nominal.name] * units.inputs
        steps = [BranchTracker(own.mechanism, own).step(home + away) for own in both]
        if any(step.event is not Event.NONE for step in steps):
            continue
        both = [step.equilibrium for step in steps]
        inputs.append(home + away)
        poses.append(both[0].pose + _DEVIATION * generator.normal(size=nominal.dof) * units.pose)
    return pcm_gym.Measurements(np.array(inputs), np.array(poses))
