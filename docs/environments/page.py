"""What a page says of an environment: all of it is asked of the environment, its task and their docstrings."""

import inspect
import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Any

import gymnasium
from docstring_parser import DocstringParam
from gymnasium.envs.registration import EnvSpec
from jinja2 import Environment, PackageLoader, StrictUndefined

from docs.environments import docstrings
from pcm_gym.environments.arguments import DEFAULTS, EnvironmentArguments
from pcm_gym.environments.batch import MechanismVectorEnv
from pcm_gym.environments.rows import Info
from pcm_gym.environments.single import MechanismEnv
from pcm_gym.tasks import TASKS, Goals, Task, observation_elements

FOLDER = Path(__file__).parent
IMAGES = FOLDER.parent / "images" / "environments"
_DOCUMENTED = {own.__name__: own for own in (Goals, Info, MechanismEnv, MechanismVectorEnv, Task, observation_elements)}


@dataclass(frozen=True)
class Argument:
    """A keyword argument, as a page lists it; without a default where it has none."""

    name: str
    type: str
    default: str
    meaning: str


@dataclass(frozen=True)
class Increment:
    """An element of the action, as a page lists it: what it moves, by how much, and how far that can go."""

    actuator: str
    base: str
    unit: str
    size: float
    low: float
    high: float


def page_name(spec: EnvSpec) -> str:
    """File name of an environment's page."""
    return f"{_stem(spec)}.md"


def image_name(spec: EnvSpec) -> str:
    """File name of an environment's picture."""
    return f"{_stem(spec)}.png"


def environment_page(env: MechanismEnv) -> str:
    """Return the page of a registered environment."""
    spec = spec_of(env)
    return _render(
        "environment.md.jinja",
        env=env,
        spec=spec,
        image=image_name(spec),
        increments=_increments(env),
        arguments=_environment_arguments(spec),
        task_arguments=_task_arguments(env.task),
        batch_arguments=_batch_arguments(),
        hold_steps=environment_defaults()["hold_steps"],
    )


def index_page(envs: Iterable[MechanismEnv]) -> str:
    """Return the page that lists the environments."""
    return _render(
        "index.md.jinja", envs=[(spec_of(env), env) for env in envs], page_name=page_name, image_name=image_name
    )


def environment_defaults() -> dict[str, Any]:
    """Return the keyword arguments of an environment, with their defaults."""
    return _defaults(MechanismEnv) | DEFAULTS


def environment_entries() -> list[DocstringParam]:
    """Return what is documented of the keyword arguments of an environment."""
    own = [entry for entry in docstrings.entries(MechanismEnv, "param") if not entry.arg_name.startswith("**")]
    return own + docstrings.entries(EnvironmentArguments, "param")


def spec_of(env: MechanismEnv) -> EnvSpec:
    """Return what is registered under the id by which an environment was made."""
    if env.spec is None:
        raise ValueError(f"the environment must be made by its id, got {env!r}")
    return gymnasium.spec(env.spec.id)


def _increments(env: MechanismEnv) -> list[Increment]:
    mechanism = env.mechanism
    numbers = zip(env.max_action, mechanism.lower_limits, mechanism.upper_limits, strict=True)
    return [
        Increment(
            docstrings.description(leg.actuator),
            f"({', '.join(map(_number, leg.actuator.base))})",
            leg.actuator.unit,
            *map(float, own),
        )
        for leg, own in zip(mechanism.legs, numbers, strict=True)
    ]


def _environment_arguments(spec: EnvSpec) -> list[Argument]:
    """Return the arguments of an environment but for those of the tasks, with the defaults of its id."""
    of_tasks = {name for task in TASKS.values() for name in task.argument_names()}
    entries = [entry for entry in environment_entries() if entry.arg_name not in of_tasks]
    return _arguments(entries, environment_defaults() | spec.kwargs)


def _task_arguments(task: Task) -> list[Argument]:
    """Return the arguments that a task has of its own, with what they are by default for its mechanism."""
    defaults = {name: getattr(task, name) for name in task.argument_names()}
    return _arguments([own for own in docstrings.entries(task, "attribute") if own.arg_name in defaults], defaults)


def _batch_arguments() -> list[Argument]:
    return _arguments(docstrings.entries(MechanismVectorEnv, "param"), _defaults(MechanismVectorEnv))


def _arguments(entries: Iterable[DocstringParam], defaults: Mapping[str, Any]) -> list[Argument]:
    return [
        Argument(
            entry.arg_name,
            entry.type_name or "",
            _literal(defaults[entry.arg_name]) if entry.arg_name in defaults else "",
            entry.description or "",
        )
        for entry in entries
    ]


def _defaults(function: Callable[..., Any]) -> dict[str, Any]:
    parameters = inspect.signature(function).parameters.values()
    return {own.name: own.default for own in parameters if own.default is not own.empty}


def _literal(value: Any) -> str:
    value = value.value if isinstance(value, Enum) else value
    return json.dumps(value) if isinstance(value, str) else repr(value)


def _stem(spec: EnvSpec) -> str:
    return spec.id.partition("/")[2]


def _render(template: str, **content: Any) -> str:
    templates = Environment(
        loader=PackageLoader("docs.environments"),
        autoescape=False,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    templates.filters["cell"] = _cell
    templates.filters["number"] = _number
    templates.globals.update(description=docstrings.description, section=docstrings.section, entries=docstrings.entries)
    return templates.get_template(template).render(api=_DOCUMENTED, **content)


def _number(value: float) -> str:
    """Return a number in four digits; rounding errors are zero."""
    return f"{round(value, 12) + 0.0:.4g}"


def _cell(text: str) -> str:
    """Return a text as one line that may stand in a table."""
    return " ".join(text.split()).replace("|", "\\|")
