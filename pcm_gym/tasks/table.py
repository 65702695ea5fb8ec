"""The table of tasks, which tasks from outside the package may join."""

from pcm_gym.mechanism.validation import one_of, shown, text
from pcm_gym.tasks.reach import Reach
from pcm_gym.tasks.switch import Switch
from pcm_gym.tasks.task import Task
from pcm_gym.tasks.track import Track

TASKS: dict[str, type[Task]] = {"Reach": Reach, "Track": Track, "Switch": Switch}


def register_task(task: type[Task], name: str | None = None) -> str:
    """Add a task to the table of this process; return its name, by default that of the class.

    Environments then know it by this name. A class that is defined again, as in a notebook, takes the place of its
    former self.

    Raises
    ------
    TypeError
        If it is no class of tasks.
    ValueError
        If another task has this name.
    """
    name = free_task_name(task, name)
    TASKS[name] = task
    return name


def free_task_name(task: type[Task], name: str | None = None) -> str:
    """Return the name under which a task may be registered; raise if it is no task, or if another one has that name."""
    if not isinstance(task, type):
        raise TypeError(f"task must be a class of tasks, got {shown(task)}")
    name = task_type(task).__name__ if name is None else text("name", name)
    known = TASKS.get(name, task)
    if (known.__module__, known.__qualname__) != (task.__module__, task.__qualname__):
        raise ValueError(f"name must be a new one, got {name!r}: it is that of {known!r}")
    return name


def task_type(task: str | type[Task]) -> type[Task]:
    """Return the task of a name in the table, or the class itself.

    Raises
    ------
    TypeError, ValueError
        If it is neither.
    """
    if isinstance(task, type) and issubclass(task, Task):
        return task
    if not isinstance(task, str):
        raise TypeError(f"task must be the name of a task, a Task or a class of tasks, got {shown(task)}")
    return TASKS[one_of("task", task, list(TASKS))]
