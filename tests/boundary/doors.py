"""The doors of the package: every public callable, with arguments that are right.

A door is tried with one argument wrong at a time, and with right arrays in every layout.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cache, partial
from typing import Any

import gymnasium
import numpy as np

import pcm_gym
from pcm_gym.environments import registration
from pcm_gym.environments.batch import MechanismVectorEnv
from pcm_gym.environments.single import MechanismEnv
from pcm_gym.kernels.statics.states import States
from pcm_gym.policies.network import Layer, Network
from pcm_gym.solving.raster import Raster
from pcm_gym.tasks import TASKS, Reach

# Names that errors use for an argument beside its own.
ALIASES = {
    "legs": ("attachment",),
    "render_workspace": ("is not an atlas", "cannot be read"),
    "path": ("is not an atlas", "cannot be read", "ending of the file"),
    "rho_max": ("rho <=",),
    "names": ("limits",),
    # arrays that are as long as another one
    "cells": ("states must have shape",),
    "branches": ("inputs must have shape",),
    "states": ("inputs must have shape",),
    "inputs": ("states must have shape", "poses must have shape"),
    "generator_seeds": ("state must be of 2 environments",),
}


@dataclass(frozen=True)
class Door:
    """A callable with right arguments.

    Attributes
    ----------
    name : str
        The public name, such as "Atlas.sample".
    call : callable
    arguments : dict
    arrays : tuple of str
        Arguments that are numbers in an array: any layout will do.
    unchecked : tuple of str
        Arguments that may be anything, because nothing is done with them.
    compares : bool
        Whether equal arguments come to equal results.
    lengthy : tuple of (str, str)
        Arguments and values, by their names, that are right and take longer than doors should be tried for.
    """

    name: str
    call: Callable[..., Any]
    arguments: dict[str, Any] = field(default_factory=dict)
    arrays: tuple[str, ...] = ()
    unchecked: tuple[str, ...] = ()
    compares: bool = True
    lengthy: tuple[tuple[str, str], ...] = ()


@cache
def mechanism(name: str) -> pcm_gym.Mechanism:
    return pcm_gym.get_mechanism(name)


@cache
def home(name: str) -> pcm_gym.Equilibrium:
    return pcm_gym.home_equilibrium(mechanism(name))


@cache
def atlas() -> pcm_gym.Atlas:
    return pcm_gym.build_atlas(mechanism("2PFR"), pitch=0.1, input_cells=6, seed_nodes=1, progress=False)


@cache
def roadmap(name: str) -> pcm_gym.Roadmap:
    return pcm_gym.build_roadmap(
        mechanism(name),
        [home(name)],
        step=np.ptp([home(name).mechanism.lower_limits, home(name).mechanism.upper_limits], axis=0) / 8.0,
    )


@cache
def curves() -> tuple[pcm_gym.SingularCurve, ...]:
    return pcm_gym.forward_singularities(mechanism("2RFR"), index=0, grid=4, progress=False)


@cache
def fold() -> pcm_gym.Equilibrium:
    own = home("2RFR-paper")
    return pcm_gym.BranchTracker(own.mechanism, own).step(own.inputs + 2.5).equilibrium


@cache
def scene(name: str) -> pcm_gym.Scene:
    task_scene = MechanismEnv(name)._simulation.scenes[0]
    _ = task_scene.roadmap
    return task_scene


@cache
def single(name: str, **keywords: Any) -> MechanismEnv:
    env = MechanismEnv(name, **keywords)
    env.reset(seed=0)
    return env


@cache
def batch(name: str, mode: str = "Disabled") -> MechanismVectorEnv:
    env = MechanismVectorEnv(2, mechanism=name, autoreset_mode=mode, threads=1)
    env.reset(seed=0)
    return env


def _from_same_state(env: Any, method: str, **arguments: Any) -> Any:
    """What a method does with an environment that is always in the same state before it."""
    base = env.unwrapped
    state = base.save_state()
    try:
        return getattr(env, method)(**arguments)
    finally:
        base.restore_state(state)


def _copy(states: States) -> States:
    return States(*(array.copy() for array in states))


def _moved(name: str, method: str, **arguments: Any) -> Any:
    """What a method of a scene makes of a copy of states."""
    states = arguments.pop("states", None)
    states = _copy(states) if isinstance(states, States) else states
    getattr(scene(name), method)(states, **arguments)
    return states


def doors() -> Iterator[Door]:
    yield from _of_mechanisms()
    for name in ("2RFR", "3PFR"):
        yield from _of_solving(name)
        yield from _of_designs(name)
        yield from _of_tasks(name)
        yield from _of_environments(name)
    yield from _of_charts()
    yield from _of_registration()


def _of_mechanisms() -> Iterator[Door]:
    pair = np.array([0.5, -0.25])
    yield Door("Rod", pcm_gym.Rod, {"length": 1.0, "bending_stiffness": 2.0})
    made_of: dict[str, Any] = {"section": pcm_gym.Strip(0.02, 0.0005), "material": pcm_gym.SPRING_STEEL}
    yield Door("Rod of a material", pcm_gym.Rod, {"length": 1.0, **made_of})
    yield Door("Rod.scaled", pcm_gym.Rod(**made_of).scaled, {"length": 0.5, "stiffness": 2.0})
    yield Door("Rod.stress_ratio", pcm_gym.Rod(**made_of).stress_ratio, {"curvature": 2.0})
    yield Door("Round", pcm_gym.Round, {"radius": 0.001})
    yield Door("Strip", pcm_gym.Strip, {"width": 0.02, "thickness": 0.0005})
    yield Door("Material", pcm_gym.Material, {"modulus": 2e11, "yield_stress": 1e9, "density": 7850.0})
    clamp = {"base": pair, "clamp_angle": 0.5, "limits": np.array([-1.0, 1.0])}
    yield Door("Revolute", pcm_gym.Revolute, clamp, ("base", "limits"))
    yield Door("Prismatic", pcm_gym.Prismatic, {**clamp, "axis_angle": 0.25}, ("base", "limits"))
    for actuator in (pcm_gym.Revolute((0.0, 0.0)), pcm_gym.Prismatic((0.0, 0.0), 0.5, 0.5)):
        kind = type(actuator).__name__
        yield Door(f"{kind}.clamp_point", actuator.clamp_point, {"value": 0.5})
        yield Door(f"{kind}.clamp_direction", actuator.clamp_direction, {"value": 0.5})
        yield Door(f"{kind}.distance", actuator.distance, {"point": pair}, ("point",))
    own = mechanism("2RFR")
    leg = {"actuator": own.legs[0].actuator, "rod": own.legs[0].rod, "attachment": np.zeros(2)}
    yield Door("Leg", pcm_gym.Leg, leg, ("attachment",))
    whole: dict[str, Any] = {"name": "mine", "legs": own.legs, "home_inputs": np.array([1.0, 0.5]), "home_pose": pair}
    whole |= {"description": "two rods", "reference": pcm_gym.Rod()}
    yield Door("Mechanism", pcm_gym.Mechanism, whole, ("home_inputs", "home_pose"))
    for name, values in (("2RFR", pair), ("3PFR", np.array([0.25, 0.5, -0.5]))):
        own = mechanism(name)
        yield Door("Mechanism.check_inputs", own.check_inputs, {"inputs": values}, ("inputs",))
        yield Door("Mechanism.check_pose", own.check_pose, {"pose": values}, ("pose",))
        yield Door("Mechanism.check_load", own.check_load, {"load": values}, ("load",))
        yield Door("Mechanism.hinges", own.hinges, {"pose": values}, ("pose",))
    yield Door("get_mechanism", pcm_gym.get_mechanism, {"name": "2RFR"})
    yield Door("load_mechanism", pcm_gym.load_mechanism, {"path": "/nowhere.yaml"})
    yield Door("mechanism_names", pcm_gym.mechanism_names)
    yield Door("register_mechanism", pcm_gym.register_mechanism, {"mechanism": own})


def _of_solving(name: str) -> Iterator[Door]:
    own, here = mechanism(name), home(name)
    inputs, load, dof = here.inputs, np.zeros(own.dof), own.dof
    at = {"mechanism": own, "state": here.state, "inputs": inputs, "load": load}
    yield Door("Equilibrium", pcm_gym.Equilibrium, at, ("state", "inputs", "load"))
    yield Door("Equilibrium.shape", here.shape, {"points": 5})
    yield Door("Equilibrium.kernel_values", here.kernel_values)
    rod = here.rods[0]
    state = {"modulus": rod.modulus, "psi": rod.psi, "mode": rod.mode, "rho": rod.rho, "force": np.array([0.5, 0.25])}
    state |= {"largest_curvature": rod.largest_curvature, "stress_ratio": 0.5}
    yield Door("RodState", pcm_gym.RodState, state, ("force",))
    asked = {"mechanism": own, "load": load, "rho_max": 9.0 if dof == 2 else 6.5}
    more = {"modes": [1, {1, 2}, (1, 2)][:dof], "refinement": 0}
    yield Door(
        "solve_forward",
        pcm_gym.solve_forward,
        {**asked, **more, "inputs": inputs, "certify": dof == 2},
        ("inputs", "load"),
    )
    pose = here.pose + 0.01
    yield Door(
        "solve_inverse", pcm_gym.solve_inverse, {**asked, **more, "pose": pose, "certify": dof == 2}, ("pose", "load")
    )
    yield Door("home_equilibrium", pcm_gym.home_equilibrium, {"mechanism": own, "load": load}, ("load",))
    tracked = {"mechanism": own, "equilibrium": here, "follow_index_changes": False, "certify": False}
    yield Door("BranchTracker", lambda **given: pcm_gym.BranchTracker(**given).equilibrium, tracked)

    def step(**given: Any) -> Any:
        return pcm_gym.BranchTracker(own, here).step(**given)

    yield Door("BranchTracker.step", step, {"inputs": inputs + 0.0625, "load": load}, ("inputs", "load"))
    way = [here, pcm_gym.BranchTracker(own, here).step(inputs + 0.0625).equilibrium]
    yield Door("certify_path", pcm_gym.certify_path, {"mechanism": own, "equilibria": way})
    yield Door("nearest_fold", pcm_gym.nearest_fold, {"equilibrium": here, "reach": 1.0})
    yield Door("critical_load", pcm_gym.critical_load, {"equilibrium": here, "reach": 1.0})
    structure = pcm_gym.StructuralLimits(own, ("stress", "contact"))
    yield Door("StructuralLimits", pcm_gym.StructuralLimits, {"mechanism": own, "names": ["stress"]})
    told = {"states": here.state[None], "inputs": own.units.kernel_from_inputs(inputs)[None]}
    yield Door("StructuralLimits.broken", structure.broken, told, ("states", "inputs"))
    yield Door("StructuralLimits.are_kept", structure.are_kept, told, ("states", "inputs"))
    yield Door("StructuralLimits.broken_by", structure.broken_by, {"equilibrium": here})
    yield Door("snap", pcm_gym.snap, {"equilibrium": fold()})


def _of_designs(name: str) -> Iterator[Door]:
    own, here, count = mechanism(name), home(name), 4
    parameters = [pcm_gym.DesignParameter("length", 0), pcm_gym.DesignParameter("clamp_angle", 1)]
    values = np.array([each.value(own) for each in parameters])
    yield Door("DesignParameter", pcm_gym.DesignParameter, {"name": "length", "leg": 1})
    yield Door("DesignParameter.value", parameters[0].value, {"mechanism": own})
    changed = {"mechanism": own, "parameters": parameters, "values": values}
    yield Door("change_design", pcm_gym.change_design, changed, ("values",))
    derived = {"equilibrium": here, "parameters": parameters}
    yield Door("design_derivatives", lambda **given: pcm_gym.design_derivatives(**given).pose, derived)
    other = pcm_gym.change_design(own, parameters, 1.01 * values)
    yield Door("follow_design", pcm_gym.follow_design, {"equilibrium": here, "mechanism": other})
    inputs = here.inputs + 0.01 * np.arange(count)[:, None] * own.units.inputs
    poses = np.array([pcm_gym.BranchTracker(own, here).step(each).equilibrium.pose for each in inputs])
    measured = {"inputs": inputs, "poses": poses, "load": np.zeros(own.dof), "deviations": np.ones(own.dof)}
    yield Door("Measurements", lambda **given: pcm_gym.Measurements(**given).inputs, measured, tuple(measured))
    asked = {"mechanism": own, "measurements": pcm_gym.Measurements(inputs, poses), "parameters": parameters}
    yield Door("calibrate", lambda **given: pcm_gym.calibrate(**given).values, {**asked, "start": here})
    wanted: dict[str, Any] = {"mechanism": own, "objective": "margin", "parameters": parameters}
    wanted |= {"bounds": np.stack([0.9 * values - 0.1, 1.1 * values + 0.1], axis=1), "inputs": inputs[:2]}
    wanted |= {"load": np.zeros(own.dof), "start": here, "least_margin": 0.0625, "most_evaluations": 2}
    arrays = ("bounds", "inputs", "load")
    yield Door("optimise_design", lambda **given: pcm_gym.optimise_design(**given).values, wanted, arrays)


def _of_charts() -> Iterator[Door]:
    own, chart, paths = mechanism("2PFR"), atlas(), roadmap("2PFR")
    resolution = {"pitch": 0.2, "input_cells": 4, "seed_nodes": 1, "orientation": None, "progress": False}
    built = {"mechanism": own, "load": np.zeros(2), "rho_max": 9.0, **resolution}
    default = (("input_cells", "None"), ("pitch", "None"))
    made = Door("build_atlas", lambda **given: pcm_gym.build_atlas(**given).over_poses.counts, built, ("load",))
    yield replace(made, lengthy=default)
    yield Door("Atlas.workspace", chart.workspace, {"branch": 0, "orientation": None})
    yield Door("Atlas.at_pose", chart.at_pose, {"pose": np.array([0.0, 0.875])}, ("pose",))
    yield Door("Atlas.at_inputs", chart.at_inputs, {"inputs": np.array([0.125, 0.0])}, ("inputs",))
    yield Door("Atlas.branch_of", chart.branch_of, {"equilibrium": home("2PFR")})

    asked = {"rng": np.random.default_rng(0), "count": 3, "branch": 0, "over": "poses"}
    yield Door("Atlas.sample", chart.sample, asked, compares=False)
    fields = {name: getattr(chart, name) for name in pcm_gym.Atlas.__dataclass_fields__}
    yield Door("Atlas", lambda **given: pcm_gym.Atlas(**given).branches, fields, ("load",))
    over = chart.over_inputs
    fields = {name: getattr(over, name) for name in pcm_gym.RasterStates.__dataclass_fields__}
    yield Door("RasterStates", pcm_gym.RasterStates, fields, ("offsets", "branches", "inputs", "poses", "margins"))
    yield Door("RasterStates.rows", over.rows, {"cells": np.array([0, 3])})
    yield Door("RasterStates.covered", over.covered, {"branch": 0})
    fields = {name: getattr(over.raster, name) for name in Raster.__dataclass_fields__}
    yield Door("Raster", Raster, fields, ("first_node", "pitch"))
    yield Door("Raster.nodes", over.raster.nodes, {"cells": np.array([0, 3])})
    region = chart.workspace()
    yield Door("Region", pcm_gym.Region, {"raster": region.raster, "mask": region.mask})
    yield Door("Region.contains", region.contains, {"points": np.array([[0.0, 0.5], [0.25, 9.0]])}, ("points",))
    states = chart.at_pose(home("2PFR").pose)
    fields = {name: getattr(states, name) for name in pcm_gym.StableStates.__dataclass_fields__}
    yield Door("StableStates", pcm_gym.StableStates, fields, ("load", "states", "inputs"))

    seeds = {"mechanism": own, "seeds": [home("2PFR")], "step": np.array([0.25, 0.25]), "least_margin": 0.0}
    yield Door("build_roadmap", lambda **given: pcm_gym.build_roadmap(**given).states, seeds, ("step",))
    yield Door("find_falls", pcm_gym.find_falls, {"roadmap": paths, "most": 2})
    fields = {name: getattr(paths, name) for name in pcm_gym.Roadmap.__dataclass_fields__}
    yield Door("Roadmap", lambda **given: pcm_gym.Roadmap(**given).components, fields, ("states", "inputs"))
    counted = {"nodes": np.array([0, 1]), "falls": np.array([[0, 1]]), "most": 4.0}
    yield Door("Roadmap.step_counts", paths.step_counts, counted)
    yield Door("Roadmap.way", paths.way, {"start": 0, "goal": 1})
    yield Door("Roadmap.equilibrium", paths.equilibrium, {"node": 1})
    yield Door("Roadmap.checked_nodes", partial(paths.checked_nodes, "nodes"), {"nodes": np.array([0, 1])})

    yield from _of_plans()

    window = {"mechanism": own, "load": np.zeros(2), "rho_max": 6.0, "progress": False, "grid": 1}
    window |= {"bounds": [(-0.25, 0.25)] * 2, "held": {}}
    yield Door("forward_singularities", pcm_gym.forward_singularities, {**window, "index": 0}, ("load", "bounds"))
    yield Door("inverse_singularities", pcm_gym.inverse_singularities, window, ("load", "bounds"))
    fields = {name: getattr(curves()[-1], name) for name in pcm_gym.SingularCurve.__dataclass_fields__}
    free = ("ends", "indices")  # told, not used
    yield Door("SingularCurve", pcm_gym.SingularCurve, fields, ("load", "states", "inputs", "tangents"), free)
    yield Door("SingularCurve.equilibrium", curves()[-1].equilibrium, {"k": 3})
    line = {"inputs": np.array([[0.0, 0.0], [0.125, 0.0625]]), "load": np.zeros(2)}
    drawn: dict[str, Any] = {"mechanism": own, "along": line, "rho_max": 4.0, "slices": 1, "certify": False}
    drawn |= {"progress": False}
    yield Door("bifurcation_diagram", lambda **given: pcm_gym.bifurcation_diagram(**given).points, drawn)
    yield Door("BifurcationDiagram.at", pcm_gym.bifurcation_diagram(**drawn).at, {"fraction": 0.25})
    yield Door("find_crossings", pcm_gym.find_crossings, {"curves": curves()[-2:]})
    yield Door("load_atlas", pcm_gym.load_atlas, {"path": "/nowhere"})
    yield Door("load_policy", pcm_gym.load_policy, {"source": "/nowhere.npz", "difficulty": "none", "kind": "best"})
    yield Door("shipped_policies", pcm_gym.shipped_policies)
    yield Door("Policy", pcm_gym.Policy, {"network": network(), "card": {}})
    yield Door("Policy.load", pcm_gym.Policy.load, {"path": "/nowhere"})
    yield Door("UndecidedRegion.contains", _undecided().contains, {"equilibrium": home("2RFR")})


def network() -> Network:
    """Return a network of one layer, for two legs."""
    layer = Layer(np.zeros((9, 2), dtype=np.float32), np.zeros(2, dtype=np.float32))
    keys = ("observation", "achieved_goal", "desired_goal")
    return Network(keys, (5, 2, 2), "concatenated", "tanh", "clip", 0.05, (layer,), None)


def _undecided() -> pcm_gym.UndecidedRegion:
    return pcm_gym.UndecidedRegion("fold", np.array([[0.0, 1.0]] * 2), np.array([[-1.0, 1.0]] * 2))


def _of_tasks(name: str) -> Iterator[Door]:
    own, here, place = mechanism(name), home(name), scene(name)
    goals = pcm_gym.Goals(own)
    made = {"mechanism": own, "reward_type": "dense", "success_distance": 0.02, "with_inputs": False}
    yield Door("Goals", pcm_gym.Goals, made)
    goal = goals.of_equilibrium(here)
    yield Door("Goals.elements_in", goals.elements_in, {"steps": 2})
    states = {"x": here.state[None], "inputs": own.units.kernel_from_inputs(here.inputs)[None]}
    yield Door("Goals.of_states", goals.of_states, states, ("x", "inputs"))
    yield Door("Goals.of_pose", goals.of_pose, {"pose": here.pose}, ("pose",))
    yield Door("Goals.of_equilibrium", goals.of_equilibrium, {"equilibrium": here})
    yield Door("Goals.pose", goals.pose, {"goal": goal}, ("goal",))
    scored = {"achieved": np.stack([goal, goal + 0.25]), "desired": np.stack([goal, goal])}
    yield Door("Goals.score", goals.score, scored, ("achieved", "desired"))
    yield Door("Goals.distance", goals.distance, scored, ("achieved", "desired"))
    task = Reach(goals)
    rewarded = {"achieved_goal": scored["achieved"], "desired_goal": goal}
    yield Door("Task.compute_reward", task.compute_reward, rewarded, ("achieved_goal", "desired_goal"))
    yield Door("Task.score", task.score, scored, ("achieved", "desired"))
    drawn = {"scene": place, "generators": [np.random.default_rng(0)], "threads": 1}
    yield Door("Task.sample", task.sample, drawn, compares=False)
    yield Door("Task", Reach, {"goals": goals, "difficulty": "near"})
    yield Door("Task.argument_names", task.argument_names)
    yield Door("Task.roadmap", lambda **given: task.roadmap(**given).states, {"scene": place})
    yield Door("Task.metrics", task.metrics, scored, unchecked=("achieved", "desired"))
    fields = {key: getattr(place, key) for key in ("mechanism", "load", "stride", "margin", "origin")}
    yield Door("Scene", pcm_gym.Scene, fields, ("load", "stride"))
    numbers = np.full((2, 1 + own.leg_count), 0.5)
    yield Door("Scene.starts", place.starts, {"numbers": numbers, "threads": 1}, ("numbers",))
    yield Door("Scene.nodes", place.nodes, {"numbers": numbers[:, 0]}, ("numbers",))
    yield Door("Scene.check_seed", place.check_seed)
    yield Door("Scene.check_roadmap", place.check_roadmap)
    yield Door("Scene.announce", place.announce)
    nodes = np.array([0, 1])
    straight = {"start": place.at_nodes(nodes), "ends": place.at_nodes(nodes), "threads": 1}
    yield Door("Scene.leads_straight", place.leads_straight, straight)
    moved = {"states": place.at_nodes(nodes), "numbers": numbers[:, 1:], "threads": 1}
    yield Door("Scene.move_within_cells", partial(_moved, name, "move_within_cells"), moved, ("numbers",))
    beside = {"nodes": nodes, "numbers": numbers[:, 1:], "threads": 1}
    yield Door("Scene.beside", place.beside, beside, ("numbers",))
    yield Door("Scene.at_nodes", place.at_nodes, {"nodes": nodes})
    yield Door("Scene.states", place.states, states, ("x", "inputs"))
    yield Door("Scene.at_equilibrium", place.at_equilibrium, {"equilibrium": here, "count": 2})
    walked = {"states": place.at_nodes(nodes), "numbers": numbers, "steps_range": (1, 2), "threads": 1}
    yield Door("Scene.walk", partial(_moved, name, "walk"), walked, ("numbers",))
    yield Door(
        "Episodes", pcm_gym.Episodes, {"states": place.at_nodes(nodes), "goals": np.zeros((2, 1, 2))}, ("goals",)
    )
    yield Door("observation_elements", pcm_gym.observation_elements, {"mechanism": own})


def _of_environments(name: str) -> Iterator[Door]:
    env, rows, legs = single(name), batch(name), mechanism(name).leg_count
    made: dict[str, Any] = {
        "mechanism": name,
        "render_mode": None,
        "render_ghosts": False,
        "render_workspace": None,
        "task": "Reach",
        "reward_type": "dense",
        "difficulty": "near",
        "success_distance": 0.02,
        "hold_steps": 3,
        "on_instability": "terminate",
        "max_action": np.full(legs, 0.0625),
        "singular_margin": 0.03125,
        "load": np.zeros(mechanism(name).dof),
        "observe_load": True,
        "randomisation": {},
        "variants": 2,
        "actuator_lag": 0.0,
        "rate_limit": np.full(legs, 0.0625),
        "backlash": np.zeros(legs),
        "observation_noise": 0.0,
    }
    arrays = ("max_action", "load", "rate_limit", "backlash")
    yield Door("MechanismEnv", lambda **given: MechanismEnv(**given).max_action, made, arrays)
    more = {"num_envs": 2, "max_episode_steps": 5, "autoreset_mode": "SameStep", "threads": 1}
    yield Door("MechanismVectorEnv", lambda **given: MechanismVectorEnv(**(made | given)).max_action, more)
    action, here = np.full(legs, 0.5), home(name)
    shield, shields = pcm_gym.SolverShield(env), pcm_gym.VectorSolverShield(rows)
    of_env, of_rows = partial(_from_same_state, env), partial(_from_same_state, rows)
    yield Door("MechanismEnv.step", partial(of_env, "step"), {"action": action}, ("action",))
    yield Door("MechanismVectorEnv.step", partial(of_rows, "step"), {"actions": np.tile(action, (2, 1))}, ("actions",))
    yield Door("SolverShield.step", partial(_from_same_state, shield, "step"), {"action": action}, ("action",))
    shielded = partial(_from_same_state, shields, "step")
    yield Door("VectorSolverShield.step", shielded, {"actions": np.tile(action, (2, 1))}, ("actions",))
    costly = partial(_from_same_state, pcm_gym.CostStep(env), "step")
    yield Door("CostStep.step", costly, {"action": action}, ("action",))
    yield Door("CostStep", pcm_gym.CostStep, {"env": env})
    margin = {"least_margin": 0.125}
    yield Door("SolverShield", lambda **given: pcm_gym.SolverShield(**given).least_margin, {"env": env, **margin})
    shielding = {"env": rows, **margin}
    yield Door("VectorSolverShield", lambda **given: pcm_gym.VectorSolverShield(**given).least_margin, shielding)
    yield Door("MechanismEnv.preview", env.preview, {"actions": np.tile(action, (3, 1))}, ("actions",))
    yield Door("MechanismVectorEnv.preview", rows.preview, {"actions": np.tile(action, (2, 3, 1))}, ("actions",))
    goal = env.task.goals.of_equilibrium(here)
    rewarded = {"achieved_goal": np.stack([goal, goal + 0.25, goal]), "desired_goal": goal, "info": {}}
    for kind, own in (("MechanismEnv", env), ("MechanismVectorEnv", rows)):
        yield Door(f"{kind}.compute_reward", own.compute_reward, rewarded, ("achieved_goal", "desired_goal"), ("info",))
        yield Door(f"{kind}.save_state", lambda own=own: own.save_state()["rows"])
        yield Door(f"{kind}.render", own.render)
    yield Door("MechanismVectorEnv.equilibrium", rows.equilibrium, {"row": 1})
    yield Door("MechanismEnv.true_mechanism", env.true_mechanism)
    yield Door("MechanismVectorEnv.true_mechanism", rows.true_mechanism, {"row": 1})
    yield Door("MechanismVectorEnv.goal", rows.goal, {"row": 1})
    yield from _of_resets(name)
    for kind, own in (("MechanismEnv", env), ("MechanismVectorEnv", rows)):
        state = own.save_state()
        yield Door(f"{kind}.restore_state", partial(_from_same_state, own, "restore_state"), {"state": state})

        def restore(own: Any = own, state: Any = state, **changed: Any) -> Any:
            return _from_same_state(own, "restore_state", state={**state, **changed})

        yield Door(f"{kind}.restore_state", restore, {key: value for key, value in state.items() if key != "kept"})

        def restore_rows(own: Any = own, state: Any = state, **changed: Any) -> Any:
            return _from_same_state(own, "restore_state", state={**state, "rows": {**state["rows"], **changed}})

        arrays = tuple(key for key, value in state["rows"].items() if value.dtype == np.float64 and key != "witness")
        yield Door(f"{kind}.restore_state", restore_rows, state["rows"], arrays)


def _of_resets(name: str) -> Iterator[Door]:
    env, rows, here = single(name), batch(name), home(name)
    for kind, own in (("MechanismEnv", env), ("MechanismVectorEnv", rows)):
        yield Door(f"{kind}.reset", partial(_from_same_state, own, "reset"), {"seed": 3, "options": {}})

        def reset(own: Any = own, **options: Any) -> Any:
            return _from_same_state(own, "reset", seed=3, options=options)

        options = {"inputs": here.inputs, "goal": here.pose, "load": np.zeros(here.mechanism.dof)}
        yield Door(f"{kind}.reset", reset, options, ("inputs", "goal", "load"))
        yield Door(f"{kind}.reset", reset, {"equilibrium": here})
    mask = {"reset_mask": np.array([True, False])}
    masked = partial(_from_same_state, rows, "reset")
    yield Door("MechanismVectorEnv.reset", lambda **options: masked(seed=3, options=options), mask)


def _of_plans() -> Iterator[Door]:
    own, start, paths = mechanism("2PFR"), home("2PFR"), roadmap("2PFR")
    how: dict[str, Any] = {"step": np.array([0.0625, 0.0625]), "least_margin": 0.0625}
    planner = pcm_gym.MotionPlanner(own, **how)
    motion = planner.plan(start, start.pose)
    asked = {"start": start, "goal": start.pose, "mechanism": own, **how}
    yield Door("plan_motion", lambda **given: pcm_gym.plan_motion(**given).inputs, asked, ("goal", "step"))
    of_planner = {"mechanism": own, "load": np.zeros(2), **how, "roadmaps": [paths]}
    made = Door(
        "MotionPlanner",
        lambda **given: pcm_gym.MotionPlanner(**given).plan(start, start.pose).length,
        of_planner,
        ("load", "step"),
    )
    yield made
    asked = {"start": start, "goal": start.pose}
    yield Door("MotionPlanner.plan", lambda **given: planner.plan(**given).inputs, asked, ("goal",))
    many = {"starts": [start], "goals": [start.pose]}
    yield Door("MotionPlanner.plan_many", lambda **given: len(planner.plan_many(**given)), many)
    fields = {name: getattr(motion, name) for name in pcm_gym.Motion.__dataclass_fields__}
    yield Door("Motion", lambda **given: pcm_gym.Motion(**given).length, fields, ("load", "inputs", "states"))
    yield Door("Motion.path_length", motion.path_length, {"step": np.array([0.0625, 0.0625])}, ("step",))


def _with_budget(tests: float) -> float:
    with pcm_gym.search_budget(tests):
        return tests


def _of_registration() -> Iterator[Door]:
    def undone(call: Callable[..., Any], table: dict[str, Any]) -> Callable[..., Any]:
        """The same, after which the table is as it was."""

        def called(**given: Any) -> Any:
            before = dict(table)
            try:
                return call(**given)
            finally:
                table.clear()
                table.update(before)

        return called

    register = undone(pcm_gym.register_environment, gymnasium.registry)

    registered = {"environment_id": "Test/Boundary-v0", "mechanism": "2RFR", "task": "Reach", "time_limit": 10}
    yield Door("register_environment", register, registered)
    yield Door("search_budget", _with_budget, {"tests": 1e6})
    yield Door("register_environments", registration.register_environments)
    yield Door("environment_ids", pcm_gym.environment_ids)
    yield Door("register_task", undone(pcm_gym.register_task, TASKS), {"task": Reach, "name": "Reach"})
