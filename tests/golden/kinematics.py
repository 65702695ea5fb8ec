"""The kinematics as scenarios, through what the package offers: sets, branches, falls, folds, curves, charts, proofs.

Symmetric mechanisms have pairs of equilibria of equal energy, curves of equal length and folds at equal distance, whose
order is a matter of rounding. So nothing here is symmetric: either the mechanism is not, or inputs or load are not.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

import pcm_gym
from pcm_gym import BranchTracker, Equilibrium, Mechanism, SnapStatus
from tests.golden.given_starts import FORK_TARGETS, fork, fork_inputs
from tests.golden.records import LOSSES, SOUND_MARGIN, Record
from tests.reference.mechanisms import random_inputs, random_load, random_mechanism

FAMILIES = ("2RFR", "2PFR", "3PFR")
# Loads, N and N m, under which every one of the mechanisms folds somewhere within its limits.
LOADS = {"2RFR": (1.0, -2.0), "2PFR": (2.0, -1.0), "3PFR": (0.5, -1.0, 0.2)}
LIGHT_LOADS = {"2RFR": (0.1, -0.3), "2PFR": (0.05, -0.1), "3PFR": (0.1, -0.2, 0.03)}
# Enough for several buckling modes; more costs a platform seconds.
LARGEST_RHO = {2: 9.0, 3: 6.5}
NAMED = ("catalogue", "random-0", "random-1")
# Least singular value of the dimensionless Jacobian with which inputs are well determined by a pose.
SOUND_JACOBIAN = 1e-2
# A rod that is nearly straight is stiff beyond bounds: of stiffness beyond this, in EI / L^3, digits are lost.
SOUND_STIFFNESS = 1e5


def mechanism_by(family: str, kind: str) -> Mechanism:
    """The family's mechanism of the catalogue, or a random one with unequal rods."""
    if kind == "catalogue":
        return pcm_gym.get_mechanism(f"{family}-paper")
    return random_mechanism(family, np.random.default_rng([int(kind.split("-")[1]), FAMILIES.index(family)]))


def described(equilibria: Sequence[Equilibrium], is_sound: Any = True, **exact: Any) -> Record:
    """All that is known of some equilibria, one row each."""
    rods = [one.rods for one in equilibria]
    close = {
        "inputs": [one.inputs for one in equilibria],
        "pose": [one.pose for one in equilibria],
        "state": [one.state for one in equilibria],
        "load": [one.load for one in equilibria],
        "energy": [one.energy for one in equilibria],
        "stability_margin": [one.stability_margin for one in equilibria],
        "estimated_margin": [one.singularity_margin for one in equilibria],
        "stiffness": [one.stiffness for one in equilibria],
        "shape": [one.shape(4) for one in equilibria],
        "force": [[rod.force for rod in own] for own in rods],
        "jacobian": [_jacobian(one) for one in equilibria],
    }
    rough = {
        "residual": [one.residual for one in equilibria],
        "rod": [[(rod.modulus, rod.psi, rod.rho) for rod in own] for own in rods],  # psi jumps, and means little at 0
    }
    whole = {
        "count": [len(equilibria)],
        "index": [one.index for one in equilibria],
        "modes": [one.modes for one in equilibria],
        "within_limits": [_is_within_limits(one) for one in equilibria],
    }
    sound = np.broadcast_to(is_sound, len(equilibria)) & np.array([_is_sound(one) for one in equilibria], dtype=bool)
    return Record(
        {name: np.array(value) for name, value in (whole | exact).items()},
        {name: np.array(value) for name, value in close.items()},
        sound,
        {name: np.array(value) for name, value in rough.items()},
    )


def _is_within_limits(equilibrium: Equilibrium) -> bool:
    """Whether the inputs are within the limits as they are, no turns added."""
    inside = equilibrium.inputs_within_limits
    return inside is not None and np.array_equal(inside, equilibrium.inputs)


def _jacobian(equilibrium: Equilibrium) -> NDArray[np.float64]:
    try:
        return equilibrium.forward_jacobian
    except np.linalg.LinAlgError:
        return np.full((equilibrium.mechanism.dof, equilibrium.mechanism.leg_count), np.nan)


def _is_sound(equilibrium: Equilibrium) -> bool:
    stiffness = equilibrium.stiffness / equilibrium.mechanism.units.stiffness
    return equilibrium.singularity_margin > SOUND_MARGIN and np.abs(stiffness).max() < SOUND_STIFFNESS


def _inputs_are_determined(equilibrium: Equilibrium) -> bool:
    units = equilibrium.mechanism.units
    scaled = _jacobian(equilibrium) * np.outer(1.0 / units.pose, units.inputs)
    return bool(np.isfinite(scaled).all() and np.linalg.svd(scaled, compute_uv=False).min() > SOUND_JACOBIAN)


def _numbers(family: str, kind: str, of: str) -> np.random.Generator:
    return np.random.default_rng([sum(map(ord, of)), FAMILIES.index(family), NAMED.index(kind)])


def _together(records: Sequence[Record]) -> Record:
    def joined(parts: Sequence[dict[str, NDArray[Any]]]) -> dict[str, NDArray[Any]]:
        return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}

    return Record(
        joined([record.exact for record in records]),
        joined([record.close for record in records]),
        np.concatenate([record.is_sound for record in records]),
        joined([record.rough for record in records]),
    )


# All solutions


def forward_sets(family: str, kind: str) -> Record:
    """Every equilibrium at some inputs, without and with a load."""
    mechanism, numbers = mechanism_by(family, kind), _numbers(family, kind, "forward")
    rho_max, records = LARGEST_RHO[mechanism.leg_count], []
    for load in (None, random_load(mechanism, numbers)):
        inputs = random_inputs(mechanism, numbers)
        records.append(described(pcm_gym.solve_forward(mechanism, inputs, load, rho_max)))
    return _together(records)


def inverse_sets(family: str, kind: str) -> Record:
    """Every equilibrium at the pose of one that is known, without and with a load."""
    mechanism, numbers = mechanism_by(family, kind), _numbers(family, kind, "inverse")
    rho_max, records = LARGEST_RHO[mechanism.leg_count], []
    for load in (None, random_load(mechanism, numbers)):
        pose = pcm_gym.solve_forward(mechanism, random_inputs(mechanism, numbers), load, rho_max)[0].pose
        found = pcm_gym.solve_inverse(mechanism, pose, load, rho_max)
        records.append(described(found, np.array([_inputs_are_determined(one) for one in found], dtype=bool)))
    return _together(records)


def certificates(family: str) -> Record:
    """Proofs of sets of two legs: of some that can be proved, and of one at a fold, which cannot."""
    mechanism, numbers = pcm_gym.get_mechanism(f"{family}-paper"), _numbers(family, "catalogue", "proof")
    problems = [(random_inputs(mechanism, numbers), load) for load in (None, LIGHT_LOADS[family])]
    fold = next(step for step, _ in _losses(mechanism, LOADS[family], count=1))
    problems.append((fold.inputs, fold.load))
    found = [pcm_gym.solve_forward(mechanism, inputs, load, certify=True) for inputs, load in problems]
    proofs = [own.certificate for own in found if own.certificate is not None]
    summary = [(len(own), proof.proved_count, proof.is_proved) for own, proof in zip(found, proofs, strict=True)]
    reasons = [sum(region.reason == "fold" for region in proof.undecided) for proof in proofs]
    rough = {
        "examined": np.array([proof.examined for proof in proofs]),
        "rho": np.array([region.rho for proof in proofs for region in proof.undecided]),
        "tip_angle": np.array([region.tip_angle for proof in proofs for region in proof.undecided]),
    }
    exact = {
        "summary": np.array(summary[:-1]),
        "open_at_fold": np.array([not proofs[-1].is_proved, min(reasons[-1], 1)]),
    }
    described_sets = _together([described(own) for own in found[:-1]])
    return Record(described_sets.exact | exact, described_sets.close, described_sets.is_sound, rough)


# Branches and falls


def branch(family: str, is_loaded: bool, follow: bool) -> Record:
    """A walk from branch to branch along random lines of inputs, and of loads; a loss of stability leads back."""
    mechanism, numbers = pcm_gym.get_mechanism(f"{family}-paper"), _numbers(family, "catalogue", "branch")
    span, unit = mechanism.upper_limits - mechanism.lower_limits, np.array(LOADS[family])
    load = unit if is_loaded else 0.0 * unit
    start = pcm_gym.home_equilibrium(mechanism, LIGHT_LOADS[family] if is_loaded else None)
    starts = [start]
    if follow:  # on unstable branches indices change
        inputs = start.inputs + 0.03 * np.arange(1, mechanism.leg_count + 1)
        starts = list(pcm_gym.solve_forward(mechanism, inputs, start.load, LARGEST_RHO[mechanism.leg_count]))[1::4]
    tracker, steps = BranchTracker(mechanism, starts[0], follow_index_changes=follow), []
    for n in range(100):
        inputs = tracker.equilibrium.inputs + 0.15 * numbers.normal(size=mechanism.leg_count) * span
        steps.append(tracker.step(inputs, numbers.uniform(0.0, 1.0) * load if n % 3 == 0 else None))
        if steps[-1].event in (*LOSSES, 4):
            tracker = BranchTracker(mechanism, starts[n % len(starts)], follow_index_changes=follow)
    events = np.array([step.event for step in steps])
    record = described([step.equilibrium for step in steps], ~np.isin(events, (*LOSSES, 4)), event=events)
    return _with_rough(record, fraction=[step.fraction for step in steps])


def branch_of_fork() -> Record:
    """Over the pitchfork of a symmetric mechanism and back, stopping there and going through."""
    start, steps = fork(), []
    for follow in (False, True):
        tracker = BranchTracker(start.mechanism, start, follow_index_changes=follow)
        steps += [tracker.step(fork_inputs(first)) for targets in FORK_TARGETS for first in targets]
    events = np.array([step.event for step in steps])
    # each step that stops there starts at the bifurcation, whose place is only known to 1e-8, until one has led away
    record = described([step.equilibrium for step in steps], ~np.isin(events, LOSSES), event=events)
    return _with_rough(record, fraction=[step.fraction for step in steps])


def _losses(mechanism: Mechanism, load: Any, count: int) -> Any:
    """Equilibria at which stability is lost on random lines from home, each with the inputs that were the aim."""
    numbers, found = np.random.default_rng(3), 0
    home = pcm_gym.home_equilibrium(mechanism, load)
    span = mechanism.upper_limits - mechanism.lower_limits
    for _ in range(400):
        target = numbers.uniform(mechanism.lower_limits, mechanism.upper_limits)
        step = BranchTracker(mechanism, home).step(home.inputs + np.clip(target - home.inputs, -0.6 * span, 0.6 * span))
        if step.event in LOSSES and found < count:
            found += 1
            yield step.equilibrium, target


def falls_from_folds(family: str) -> Record:
    """Falls from folds, and where the branch leads on which they end.

    Where a fold is, is known to 1e-8 only: what is compared closely are the equilibria at the inputs beyond it.
    """
    mechanism, falls, steps = pcm_gym.get_mechanism(f"{family}-paper"), [], []
    for fold, target in _losses(mechanism, LIGHT_LOADS[family] if family != "2PFR" else LOADS[family], count=8):
        falls.append(pcm_gym.snap(fold))
        steps.append(BranchTracker(mechanism, falls[-1].equilibrium).step(target))
    events = np.array([step.event for step in steps])
    record = described(
        [step.equilibrium for step in steps],
        ~np.isin(events, LOSSES),
        event=events,
        status=[list(SnapStatus).index(fall.status) for fall in falls],
        landing_index=[fall.equilibrium.index for fall in falls],
    )
    return _with_falls(record, falls)


def falls_from_unstable(family: str, kind: str) -> Record:
    """Falls from unstable equilibria: where they end is determined by the inputs alone."""
    mechanism, numbers = mechanism_by(family, kind), _numbers(family, kind, "falls")
    found = pcm_gym.solve_forward(mechanism, random_inputs(mechanism, numbers), None, LARGEST_RHO[mechanism.leg_count])
    starts = [one for one in found if not one.is_stable and _is_sound(one)][:12]
    falls = [pcm_gym.snap(start) for start in starts]
    codes = [list(SnapStatus).index(fall.status) for fall in falls]
    record = described([fall.equilibrium for fall in falls], np.array(codes) == 0, status=codes)
    released = np.array([fall.energy_released for fall in falls])
    record = _with_falls(record, falls)
    return replace(record, close=record.close | {"energy_released": released})


def _with_falls(record: Record, falls: Sequence[Any]) -> Record:
    energies = np.concatenate([fall.energies for fall in falls])
    return _with_rough(
        record,
        energies=energies,
        energy_counts=[len(fall.energies) for fall in falls],
        landing=[fall.equilibrium.state for fall in falls],
        released=[fall.energy_released for fall in falls],
    )


def _with_rough(record: Record, **rough: Any) -> Record:
    more = {name: np.array(value) for name, value in rough.items()}
    return replace(record, rough=record.rough | more)


def nearest_folds(family: str, kind: str) -> Record:
    """Distances of the nearest folds. Their directions, and so their places, are only found to 1e-7."""
    mechanism, numbers = mechanism_by(family, kind), _numbers(family, kind, "nearest")
    found = pcm_gym.solve_forward(mechanism, random_inputs(mechanism, numbers), None, LARGEST_RHO[mechanism.leg_count])
    starts = [one for one in found if _is_sound(one)][:3]
    folds = [pcm_gym.nearest_fold(one) for one in starts]
    met = [fold for fold in folds if fold is not None]
    return Record(
        {"is_met": np.array([fold is not None for fold in folds])},
        {"distance": np.array([fold.distance for fold in met])},
        np.ones(len(met), dtype=bool),
        {
            "inputs": np.array([fold.inputs for fold in met]),
            "state": np.array([fold.equilibrium.state for fold in met]),
            "direction": np.array([fold.direction for fold in met]),
        },
    )


# Singular curves


def singular_curves(trace: Callable[..., Any], family: str, kind: str, keywords: dict[str, Any]) -> Record:
    """Curves of folds or of inverse singularities: how many and of what kind; of folds also cusps and crossings.

    Where the vertices are, is a matter of the length of the steps; cusps and crossings are points of their own. Inverse
    singularities have hundreds of crossings, some of them nearly tangential, and cusps that are all but smooth:
    rounding decides whether these are found.
    """
    mechanism = mechanism_by(family, kind)
    curves = trace(mechanism, LIGHT_LOADS[family], progress=False, **keywords)
    crossings = pcm_gym.find_crossings(curves)
    points = {
        "cusps": np.concatenate([curve.points[list(curve.cusps)] for curve in curves]),
        "crossings": np.array([crossing.point for crossing in crossings]).reshape(-1, 2),
    }
    counts = {
        "cusp_counts": np.array([len(curve.cusps) for curve in curves]),
        "crossing_curves": np.array([crossing.curves for crossing in crossings], dtype=np.int64).reshape(-1, 2),
    }
    codes = ("closed", "largest_load", "bounds", "solver_failure")
    exact = {
        "ends": np.array([[codes.index(end) for end in curve.ends] for curve in curves]),
        "indices": np.array([curve.indices or (-1, -1) for curve in curves]),
    }
    rough = {f"points_{k}": curve.points[::10] for k, curve in enumerate(curves)}
    rough |= {f"states_{k}": curve.states[::10] for k, curve in enumerate(curves)}
    rough["lengths"] = np.array([curve.arc_length[-1] for curve in curves])
    if not all(curve.is_forward for curve in curves):
        return Record(exact, {}, np.empty(0, dtype=bool), rough | points | counts)
    own = np.concatenate(list(points.values()))
    return Record(exact | counts, {"points": own}, np.ones(len(own), dtype=bool), rough)


# Charts


def atlas(family: str, keywords: dict[str, Any]) -> Record:
    """A coarse atlas: its branches, their areas and some equilibria drawn from it."""
    mechanism = pcm_gym.get_mechanism(f"{family}-paper")
    made = pcm_gym.build_atlas(mechanism, LIGHT_LOADS[family], progress=False, **keywords)
    drawn = made.sample(np.random.default_rng(0), 12)
    record = described(
        list(drawn),
        sizes=[
            len(made.over_poses),
            len(made.over_inputs),
            len(made.branches),
            -1 if made.home_branch is None else made.home_branch,
        ],
        cells=[(int(own.workspace.mask.sum()), int(own.input_region.mask.sum())) for own in made.branches],
        drawn_branches=drawn.branches,
    )
    parts = {"poses": made.over_poses, "inputs": made.over_inputs}
    rough = {f"{name}_{of}": getattr(part, of) for name, part in parts.items() for of in ("rods", "inputs", "branches")}
    areas = [(own.workspace.area, own.input_region.area, own.largest_rho) for own in made.branches]
    return _with_rough(record, areas=areas, **rough)


def roadmap(family: str, least_margin: float) -> Record:
    """A roadmap from home: its nodes, its ways, and where the mechanism falls from it."""
    mechanism = pcm_gym.get_mechanism(f"{family}-paper")
    home = pcm_gym.home_equilibrium(mechanism, LIGHT_LOADS[family])
    made = pcm_gym.build_roadmap(mechanism, [home], least_margin=least_margin)
    falls = pcm_gym.find_falls(made, 16)
    steps, counts = made.step_counts([made.seeds[0]], falls)
    record = described(
        [made.equilibrium(node) for node in range(0, len(made), max(1, len(made) // 40))],
        sizes=[len(made), int((made.ways >= 0).sum()), int(made.components.max()), len(falls), *made.seeds],
        raster=made.raster.shape,
        reached=[int(np.isfinite(steps).sum()), int(steps[np.isfinite(steps)].sum()), int((counts > 0.0).sum())],
    )
    whole = {"states": made.states, "node_inputs": made.inputs, "cells": made.cells, "ways": made.ways, "falls": falls}
    return _with_rough(record, densities=made.pose_densities, **whole)


# The table

Scenario = Callable[[], Record]


def _scenarios() -> dict[str, Scenario]:
    scenarios: dict[str, Scenario] = {}
    for family in FAMILIES:
        for kind in NAMED:
            scenarios[f"forward-{family}-{kind}"] = partial(forward_sets, family, kind)
            scenarios[f"inverse-{family}-{kind}"] = partial(inverse_sets, family, kind)
        for is_loaded in (False, True):
            for follow in (False, True):
                name = f"branch-{family}-{'loaded' if is_loaded else 'free'}-{'follow' if follow else 'stop'}"
                scenarios[name] = partial(branch, family, is_loaded, follow)
        scenarios[f"falls-folds-{family}"] = partial(falls_from_folds, family)
        for kind in NAMED[:2]:
            scenarios[f"falls-unstable-{family}-{kind}"] = partial(falls_from_unstable, family, kind)
            scenarios[f"nearest-{family}-{kind}"] = partial(nearest_folds, family, kind)
        scenarios[f"roadmap-{family}"] = partial(roadmap, family, 0.05 if family == "2RFR" else 0.02)
    scenarios["branch-fork"] = branch_of_fork
    for family in FAMILIES[:2]:
        scenarios[f"certificates-{family}"] = partial(certificates, family)
        for kind in NAMED[:2]:
            keywords = {"rho_max": 6.0}
            scenarios[f"folds-{family}-{kind}"] = partial(
                singular_curves, pcm_gym.forward_singularities, family, kind, {**keywords, "index": 0}
            )
            scenarios[f"borders-{family}-{kind}"] = partial(
                singular_curves, pcm_gym.inverse_singularities, family, kind, {**keywords, "grid": 6}
            )
        scenarios[f"atlas-{family}"] = partial(
            atlas, family, {"rho_max": 7.0, "pitch": 0.03, "input_cells": 40, "seed_nodes": 5}
        )
    held = {"rho_max": 6.5, "held": {0: 0.05}, "grid": 1, "index": 0}
    scenarios["folds-3PFR-catalogue"] = partial(
        singular_curves, pcm_gym.forward_singularities, "3PFR", "catalogue", held
    )
    coarse = {"rho_max": 6.5, "pitch": 0.05, "input_cells": 8, "seed_nodes": 1, "orientation": 0.1}
    scenarios["atlas-3PFR"] = partial(atlas, "3PFR", coarse)
    return scenarios


KINEMATICS = _scenarios()
