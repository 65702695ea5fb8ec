"""What the page shows, as data: numbers in SI units and radians, and null for what is not finite."""

import json
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from pcm_gym.arrays import Array
from pcm_gym.mechanism import Mechanism
from pcm_gym.mechanism.text import mechanism_to_json
from pcm_gym.plain import plain
from pcm_gym.rendering.camera import rail_ends, reach_bounds
from pcm_gym.rendering.polylines import equilibrium_polylines
from pcm_gym.solving import BifurcationDiagram, Equilibrium, SingularCurve

Data = dict[str, Any]

# Points of each rod that are drawn, and digits of places.
_POINTS, _DIGITS = 41, 6
_MOST_VERTICES = 400  # of a curve of folds
_ALWAYS_KNOWN = 9.0


def mechanism_view(mechanism: Mechanism) -> Data:
    """Return what is drawn of a mechanism and does not move, and what its inputs are."""
    x_min, x_max, y_min, y_max = reach_bounds(mechanism)
    return {
        "name": mechanism.name,
        "dof": mechanism.dof,
        "bounds": [x_min, x_max, y_min, y_max],
        "force": mechanism.units.force,
        "loads": mechanism.units.load,
        "legs": [
            {
                "is_angle": leg.actuator.is_angle,
                "limits": leg.actuator.limits,
                "base": leg.actuator.base,
                "rail": None if leg.actuator.is_angle else rail_ends(leg),
            }
            for leg in mechanism.legs
        ],
    }


def equilibrium_view(equilibrium: Equilibrium) -> Data:
    """Return what is drawn and told of an equilibrium."""
    lines = equilibrium_polylines(equilibrium, _POINTS)
    return {
        "pose": equilibrium.pose,
        "energy": equilibrium.energy,
        "index": equilibrium.index,
        "is_stable": equilibrium.is_stable,
        "stability_margin": equilibrium.stability_margin,
        "singularity_margin": equilibrium.singularity_margin,
        "modes": equilibrium.modes,
        "rho": max(rod.rho for rod in equilibrium.rods),
        "stress": [rod.stress_ratio for rod in equilibrium.rods],
        "efforts": equilibrium.actuator_forces,
        "rods": np.round(lines.rods, _DIGITS),
        "clamp_angles": lines.clamp_angles,
        "platform": lines.platform if equilibrium.mechanism.dof == 3 else None,
    }


def folds_view(curves: Sequence[SingularCurve]) -> Data:
    """Return curves of folds over inputs and over poses."""
    return {"curves": [_curve_view(curve) for curve in curves]}


def _curve_view(curve: SingularCurve) -> Data:
    kept = np.unique(np.append(np.linspace(0, len(curve) - 1, _MOST_VERTICES).astype(int), curve.cusps).astype(int))
    return {
        "inputs": np.round(curve.points[kept], _DIGITS),
        "poses": np.round(curve.poses[kept, :2], _DIGITS),
        "cusps": np.round(curve.points[list(curve.cusps)], _DIGITS),
        "plane": curve.plane,
        "is_limit": curve.is_stability_limit,
    }


def diagram_view(diagram: BifurcationDiagram, first: float, last: float) -> Data:
    """Return a diagram whose abscissa goes from `first` to `last`."""

    def abscissa(fractions: Array) -> Array:
        return np.round(first + fractions * (last - first), _DIGITS)

    branches = [
        {
            "abscissa": abscissa(branch.fractions),
            "energy": branch.energies,
            "pose": np.round(branch.poses, _DIGITS),
            "pieces": [(*piece, branch.index_of(piece)) for piece in branch.pieces()],
        }
        for branch in diagram.branches
    ]
    points = [
        {"kind": str(point.kind), "branch": point.branches[0][0], "vertex": point.branches[0][1]}
        for point in diagram.points
    ]
    return {"range": [first, last], "branches": branches, "points": points}


def python_lines(equilibrium: Equilibrium, is_in_catalogue: bool) -> str:
    """Return lines of Python that make the same equilibrium."""
    mechanism = equilibrium.mechanism
    if is_in_catalogue:
        made = [f"mechanism = pcm_gym.get_mechanism({mechanism.name!r})"]
    else:
        made = [
            "from pcm_gym.mechanism.text import mechanism_from_json",
            "",
            f"mechanism = mechanism_from_json({mechanism_to_json(mechanism)!r})",
        ]
    largest = max(_ALWAYS_KNOWN, math.ceil(max(rod.rho for rod in equilibrium.rods) + 0.5))
    inputs, load, state = (array.tolist() for array in (equilibrium.inputs, equilibrium.load, equilibrium.state))
    lines = [
        "import pcm_gym",
        *made,
        f"found = pcm_gym.solve_forward(mechanism, {inputs}, {load}, rho_max={largest:g})",
        f"equilibrium = min(found, key=lambda each: abs(each.state - {state}).max())",
        "print(equilibrium)",
    ]
    return "\n".join(lines) + "\n"


def json_text(equilibrium: Equilibrium) -> str:
    """Return a state with its mechanism as a JSON text."""
    content = equilibrium_view(equilibrium)
    content |= {"inputs": equilibrium.inputs, "load": equilibrium.load, "residual": equilibrium.residual}
    content["mechanism"] = json.loads(mechanism_to_json(equilibrium.mechanism))
    return json.dumps(plain(content), indent=2, allow_nan=False) + "\n"
