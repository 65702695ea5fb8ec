"""Mechanisms as text and in files: JSON or YAML, with every number in full.

What they hold is told by `pcm_gym.mechanism.schema`, which is loaded when it is needed.
"""

import json
import os
from pathlib import Path
from typing import Any

from pcm_gym.mechanism.mechanism import Mechanism
from pcm_gym.mechanism.validation import file_path, instance_of, one_of, shown
from pcm_gym.mechanism.validation import text as checked_text

FILE_SUFFIXES = (".json", ".yaml", ".yml")
_LARGEST_FILE = 1 << 16  # bytes


class MechanismFileError(ValueError):
    """A file that cannot be read, or holds no mechanism; the message says why."""


class MechanismNotFoundError(MechanismFileError, FileNotFoundError):
    """There is no such file."""


def mechanism_to_json(mechanism: Mechanism) -> str:
    """Return the mechanism as JSON, from which `mechanism_from_json` makes an equal one."""
    return json.dumps(_data(mechanism))


def mechanism_from_json(text: str) -> Mechanism:
    """Return the mechanism of a JSON text.

    Raises
    ------
    ValueError
        If the text does not describe a mechanism.
    """
    from pcm_gym.mechanism.schema import mechanism_from_text

    checked_text("text", text or " ")
    try:
        return mechanism_from_text(text)
    except (TypeError, ValueError) as error:
        raise ValueError(f"the text does not describe a mechanism: {error}") from error


def save_mechanism(mechanism: Mechanism, path: str | os.PathLike[str]) -> None:
    """Write a mechanism to a file, from which `load_mechanism` makes an equal one.

    Parameters
    ----------
    mechanism : Mechanism
    path : path
        Ends in ``.json``, ``.yaml`` or ``.yml``, which tells the format.

    Raises
    ------
    ValueError
        If the ending is another one.
    OSError
        If the file cannot be written.
    """
    content = _data(instance_of("mechanism", mechanism, Mechanism))
    path = file_path("path", path)
    if _suffix(path) == ".json":
        text = json.dumps(content, indent=2) + "\n"
    else:
        import yaml

        # through JSON, for which tuples are lists
        text = yaml.safe_dump(json.loads(json.dumps(content)), sort_keys=False, default_flow_style=None)
    path.write_text(text, encoding="utf-8")


def load_mechanism(path: str | os.PathLike[str]) -> Mechanism:
    """Return the mechanism of a file, JSON or YAML, as `pcm_gym.mechanism.mechanism_schema` describes it.

    Parameters
    ----------
    path : path
        Ends in ``.json``, ``.yaml`` or ``.yml``.

    Raises
    ------
    MechanismFileError
        If the file cannot be read, is larger than 64 KiB, or holds no mechanism; a `ValueError`. If there is no such
        file it is a `FileNotFoundError` as well.
    """
    path = file_path("path", path)
    try:
        suffix = _suffix(path)
        return mechanism_from_json(_read(path) if suffix == ".json" else _json_from_yaml(_read(path)))
    except FileNotFoundError as error:
        raise MechanismNotFoundError(f"{path} cannot be read: {error.strerror}") from error
    except OSError as error:
        raise MechanismFileError(f"{path} cannot be read: {error.strerror or error}") from error
    except (RecursionError, ValueError) as error:
        raise MechanismFileError(f"{path}: {error}") from error


def _data(mechanism: Mechanism) -> dict[str, Any]:
    from pcm_gym.mechanism.schema import data_from_mechanism

    return data_from_mechanism(mechanism)


def _suffix(path: Path) -> str:
    suffix: str = one_of("ending of the file", path.suffix.lower(), FILE_SUFFIXES)
    return suffix


def _read(path: Path) -> str:
    with path.open("rb") as file:
        content = file.read(_LARGEST_FILE + 1)
    if len(content) > _LARGEST_FILE:
        raise ValueError(f"a mechanism's file has at most {_LARGEST_FILE} bytes")
    return content.decode("utf-8")


def _json_from_yaml(text: str) -> str:
    import yaml

    class Loader(yaml.SafeLoader):
        """Knows no aliases, by which a small text can stand for gigabytes."""

        def compose_node(self, parent: Any, index: Any) -> Any:
            if self.check_event(yaml.AliasEvent):
                raise yaml.YAMLError("aliases are not taken")
            return super().compose_node(parent, index)

    try:
        return json.dumps(yaml.load(text, Loader))
    except (TypeError, yaml.YAMLError) as error:
        raise ValueError(f"no YAML of numbers and text: {shown(str(error))}") from error
