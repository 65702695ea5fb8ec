"""Commands that tell what there is: mechanisms, tasks, environments, and how mechanism files look."""

from typing import Any

from pcm_gym.commands.arguments import AsJson, Name, mechanism_of
from pcm_gym.commands.errors import RefusalError
from pcm_gym.commands.output import print_json, print_lines, print_table


def list_all(as_json: AsJson = False) -> None:
    """List environments, mechanisms and tasks."""
    import pcm_gym
    from pcm_gym.environments.registration import ENVIRONMENTS
    from pcm_gym.tasks import TASKS

    mechanisms = [pcm_gym.get_mechanism(name) for name in pcm_gym.mechanism_names()]
    tasks = {name: _first_line(task) for name, task in TASKS.items()}
    if as_json:
        environments = [
            {"id": own.id, "mechanism": own.mechanism, "task": own.task, "time_limit": own.time_limit}
            for own in ENVIRONMENTS
        ]
        names = [{"name": own.name, "description": own.description} for own in mechanisms]
        print_json({"environments": environments, "mechanisms": names, "tasks": tasks})
        return
    rows = [(own.id, own.mechanism, own.task, own.time_limit) for own in ENVIRONMENTS]
    print_table(("environment", "mechanism", "task", "time limit"), rows)
    print_table(("mechanism", ""), [(own.name, own.description) for own in mechanisms])
    print_table(("task", ""), list(tasks.items()))


def info(name: Name, as_json: AsJson = False) -> None:
    """Tell all about an environment or a mechanism."""
    content = environment_data(name) if "/" in name and not name.endswith((".json", ".yaml", ".yml")) else None
    content = mechanism_data(name) if content is None else content
    if as_json:
        print_json(content)
        return
    tables = {key: value for key, value in content.items() if isinstance(value, list) and isinstance(value[0], dict)}
    print_lines({key: value for key, value in content.items() if key not in tables})
    for key, rows in tables.items():
        print_table(tuple(rows[0]), [tuple(row.values()) for row in rows], key)


def schema() -> None:
    """Print the JSON schema of mechanism files."""
    from pcm_gym.mechanism.schema import mechanism_schema

    print_json(mechanism_schema())


def known_environment(name: str) -> str:
    """Return an id; refuse it where no environment of a mechanism is known by it."""
    import difflib

    import gymnasium

    import pcm_gym
    from pcm_gym.environments.registration import ENTRY_POINT

    try:
        spec = gymnasium.spec(name)
    except gymnasium.error.Error:
        near = difflib.get_close_matches(name, pcm_gym.environment_ids(), n=1)
        hint = f"did you mean {near[0]}?" if near else "`pcm-gym list` lists all"
        raise RefusalError(f"there is no environment {name!r}: {hint}") from None
    if spec.entry_point != ENTRY_POINT:
        raise RefusalError(f"{name} is no environment of a mechanism")
    return name


def environment_data(name: str) -> dict[str, Any]:
    """Return what an environment is, as data."""
    import gymnasium

    env = gymnasium.make(known_environment(name))
    own: Any = env.unwrapped
    assert env.spec is not None
    return {
        "id": name,
        "mechanism": own.mechanism.name,
        "task": type(own.task).__name__,
        "about": _first_line(type(own.task)),
        "time_limit": env.spec.max_episode_steps,
        "max_action": own.max_action,
        "success_distance": own.success_distance,
        "singular_margin": own.singular_margin,
        "observation": [
            element._asdict() if hasattr(element, "_asdict") else vars(element) for element in own.elements
        ],
        "goal": [vars(element) for element in own.goal_elements],
    }


def mechanism_data(name: str) -> dict[str, Any]:
    """Return what a mechanism is, as data."""
    import pcm_gym

    mechanism = mechanism_of(name)
    home = pcm_gym.home_equilibrium(mechanism)
    found = pcm_gym.solve_forward(mechanism, home.inputs)
    return {
        "name": mechanism.name,
        "description": mechanism.description,
        "end_effector": "point" if mechanism.dof == 2 else "platform",
        "home_inputs": home.inputs,
        "home_pose": home.pose,
        "singularity_margin_at_home": home.singularity_margin,
        "equilibria_at_home_inputs": len(found),
        "stable_among_them": len(found.stable),
        "legs": [
            {
                "actuator": type(leg.actuator).__name__.lower(),
                "unit": leg.actuator.unit,
                "limits": list(leg.actuator.limits),
                "base": list(leg.actuator.base),
                "clamp_angle": leg.actuator.clamp_angle,
                "attachment": list(leg.attachment),
                "length": leg.rod.length,
                "bending_stiffness": leg.rod.bending_stiffness,
            }
            for leg in mechanism.legs
        ],
    }


def _first_line(documented: Any) -> str:
    return str(documented.__doc__ or "").strip().partition("\n")[0]
