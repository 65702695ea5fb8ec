"""The pages of the environments: they are what the command writes now, and say of each environment what it is."""

import ast
import inspect
import re
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

pytest.importorskip("docstring_parser")
pytest.importorskip("jinja2")
pytest.importorskip("PIL")

import pcm_gym
from docs.environments import docstrings
from docs.environments.page import (
    FOLDER,
    IMAGES,
    environment_defaults,
    environment_entries,
    environment_page,
    image_name,
    index_page,
    page_name,
    spec_of,
)
from docs.environments.picture import picture
from pcm_gym.environments.arguments import DEFAULTS, EnvironmentArguments
from pcm_gym.environments.batch import MechanismVectorEnv
from pcm_gym.environments.episodes import RESET_OPTIONS
from pcm_gym.environments.rows import Info
from pcm_gym.environments.settings import BEHAVIOURS
from pcm_gym.environments.single import MechanismEnv
from pcm_gym.tasks import TASKS
from tests.environments.rollouts import info_types, make_bare

LARGEST_PICTURE = 30_000  # bytes


@pytest.fixture(scope="module")
def envs() -> dict[str, MechanismEnv]:
    return {name: make_bare(name, render_mode="rgb_array") for name in pcm_gym.environment_ids()}


@pytest.fixture(params=pcm_gym.environment_ids())
def env(request: pytest.FixtureRequest, envs: dict[str, MechanismEnv]) -> MechanismEnv:
    return envs[request.param]


def page_of(env: MechanismEnv) -> str:
    return (FOLDER / page_name(spec_of(env))).read_text(encoding="utf-8")


def rows_under(page: str, heading: str) -> Iterator[list[str]]:
    """The cells of the table rows between a heading and the next one."""
    (part,) = re.findall(rf"^#+ {re.escape(heading)}\n(.*?)(?=^#|\Z)", page, flags=re.DOTALL | re.MULTILINE)
    for line in part.splitlines():
        if line.startswith("|") and "---" not in line:
            yield [cell.strip().strip("`") for cell in re.split(r"(?<!\\)\|", line)[1:-1]]


def names_of(documented: object, title: str) -> list[str]:
    return [entry.arg_name for entry in docstrings.entries(documented, title)]


# The committed files


def test_committed_page_is_what_the_command_writes(env: MechanismEnv) -> None:
    assert page_of(env) == environment_page(env)


def test_committed_index_is_what_the_command_writes(envs: dict[str, MechanismEnv]) -> None:
    assert (FOLDER / "README.md").read_text(encoding="utf-8") == index_page(envs.values())


def test_there_is_a_page_and_a_picture_for_each_environment_and_no_other(envs: dict[str, MechanismEnv]) -> None:
    specs = [spec_of(env) for env in envs.values()]
    assert {path.name for path in FOLDER.glob("*.md")} == {"README.md", *map(page_name, specs)}
    assert {path.name for path in IMAGES.iterdir()} == set(map(image_name, specs))


def test_committed_picture_is_small_and_of_the_size_that_is_drawn(env: MechanismEnv) -> None:
    from PIL import Image

    path = IMAGES / image_name(spec_of(env))
    assert path.stat().st_size < LARGEST_PICTURE
    with Image.open(path) as found:
        assert found.size == picture(env).size


# The docstrings and what they describe


def test_every_argument_of_an_environment_is_documented_and_no_other() -> None:
    assert [entry.arg_name for entry in environment_entries()] == list(environment_defaults())
    assert set(EnvironmentArguments.__annotations__) == set(DEFAULTS)


def test_every_argument_of_the_batch_is_documented_and_no_other() -> None:
    described = [
        name.removeprefix("**") for names in names_of(MechanismVectorEnv, "param") for name in names.split(", ")
    ]
    assert sorted(described) == sorted(inspect.signature(MechanismVectorEnv).parameters)


@pytest.mark.parametrize("task", TASKS)
def test_every_argument_of_a_task_is_documented_and_no_other(task: str) -> None:
    assert sorted(names_of(TASKS[task], "attribute")) == sorted({"goals", *TASKS[task].argument_names()})


def test_every_info_of_a_step_and_of_a_reset_is_documented_with_its_type(env: MechanismEnv) -> None:
    described = {entry.arg_name: entry.type_name for entry in docstrings.entries(Info, "attribute")}
    own = {key: kind.__name__ for key, kind in info_types(env).items() if key not in described}
    assert all(f"`{key}`" in page_of(env) for key in own)
    _, begun = env.reset(seed=0)
    *_, info = env.step(env.action_space.sample())
    for found in (begun, info):
        assert {key: type(value).__name__ for key, value in found.items()} == described | own


def test_every_reset_option_is_documented_and_no_other() -> None:
    assert sorted(names_of(MechanismEnv.reset, "Options")) == sorted(RESET_OPTIONS)


def test_every_behaviour_where_stability_is_lost_is_described() -> None:
    described = re.findall(r'^- "(\w+)":', docstrings.section(MechanismEnv, "Loss of stability"), flags=re.MULTILINE)
    assert sorted(described) == sorted(BEHAVIOURS)


def test_version_history_ends_with_the_version_of_the_ids() -> None:
    *_, last = re.findall(r"^- v(\d+):", docstrings.section(MechanismEnv, "Version history"), flags=re.MULTILINE)
    assert {name.rpartition("-v")[2] for name in pcm_gym.environment_ids()} == {last}


def test_a_section_that_is_missing_is_refused() -> None:
    with pytest.raises(ValueError, match="Action"):
        docstrings.section(TASKS["Reach"], "Action")


# The pages, read again, against the environments


def test_page_lists_every_element_with_its_bounds(env: Any) -> None:
    spaces = env.observation_space
    for heading, key in (("`observation`", "observation"), ("`achieved_goal` and `desired_goal`", "desired_goal")):
        header, *rows = rows_under(page_of(env), heading)
        assert [int(row[0]) for row in rows] == list(range(spaces[key].shape[0]))
        for column, bounds in (("least", spaces[key].low), ("greatest", spaces[key].high)):
            found = [float(row[header.index(column)]) for row in rows]
            assert found == pytest.approx(bounds.tolist(), rel=1e-3)
    names = [row[1] for row in rows_under(page_of(env), "`observation`")]
    assert names[1:] == [element.name for element in env.elements]


def test_weights_of_the_page_give_the_reward(env: MechanismEnv) -> None:
    """The formula of the page, written down here, with the numbers of the page."""
    header, *rows = rows_under(page_of(env), "`achieved_goal` and `desired_goal`")
    goal, _ = env.reset(seed=0)
    achieved, desired = goal["achieved_goal"], goal["desired_goal"] + 0.01
    weights = [float(row[header.index("weight")]) for row in rows]
    e = sum(w * (a - d) ** 2 for w, a, d in zip(weights, achieved, desired, strict=True)) ** 0.5
    expected = (1.0 / (1.0 + e) + 2.718281828459045 ** (-e / 0.05)) / 2.0
    assert env.compute_reward(achieved, desired, {}) == pytest.approx(expected, rel=1e-6)


def test_page_lists_the_action_with_its_increments(env: Any) -> None:
    header, *rows = rows_under(page_of(env), "Action")
    assert len(rows) == env.action_space.shape[0]
    assert [float(row[header.index("increment for 1")]) for row in rows] == pytest.approx(env.max_action.tolist())


def test_page_lists_the_arguments_that_the_environment_takes(env: MechanismEnv) -> None:
    listed = {row[0] for row in rows_under(page_of(env), "Arguments")} - {"argument"}
    of_other_tasks = {name for task in TASKS.values() for name in task.argument_names()}.difference(
        env.task.argument_names()
    )
    assert listed == set(environment_defaults()) - of_other_tasks


def test_defaults_of_the_page_make_the_environment(env: Any) -> None:
    """The class, given by name all that the page says to be a default, does what the environment of the id does."""
    rows = [row for row in rows_under(page_of(env), "Arguments") if row[0] != "argument"]
    made = MechanismEnv(**{row[0]: ast.literal_eval(row[2]) for row in rows})
    assert (made.task, made.mechanism) == (env.task, env.mechanism)
    for own in (made, env):
        own.reset(seed=1)
    for _ in range(40):
        (*_, terminated, truncated, info), (*_, expected) = (
            own.step(np.ones(env.action_space.shape, np.float32)) for own in (made, env)
        )
        assert info == expected
        if terminated or truncated:
            break
