"""What a browser may ask of its session: every message is checked here, and refused as a whole."""

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

_LARGEST_ID, _LARGEST_NUMBER, _MOST_VERTICES = 1 << 53, 1e6, 1 << 20
_LONGEST_NAME, _LONGEST_TEXT = 200, 1 << 15

_Number = Annotated[float, Field(ge=-_LARGEST_NUMBER, le=_LARGEST_NUMBER)]
_Axis = Annotated[int, Field(ge=0, le=2)]
_Count = Annotated[int, Field(ge=0, le=_MOST_VERTICES)]


class MessageError(ValueError):
    """A message that is none of those below."""


class _Asked(BaseModel):
    """What all messages have: the answer repeats the number."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False, frozen=True)

    id: Annotated[int, Field(ge=0, le=_LARGEST_ID)] = 0


class Choose(_Asked):
    """Take a mechanism of the catalogue, at home."""

    kind: Literal["choose"]
    name: Annotated[str, Field(min_length=1, max_length=_LONGEST_NAME)]


class Read(_Asked):
    """Take the mechanism that a JSON text describes, at home."""

    kind: Literal["read"]
    text: Annotated[str, Field(min_length=1, max_length=_LONGEST_TEXT)]


class Drive(_Asked):
    """Follow the branch to these inputs."""

    kind: Literal["drive"]
    inputs: Annotated[list[_Number], Field(min_length=2, max_length=3)]


class Drag(_Asked):
    """Follow the branch so that the end-effector comes to, or near, a place."""

    kind: Literal["drag"]
    place: Annotated[list[_Number], Field(min_length=2, max_length=2)]


class Load(_Asked):
    """Follow the branch to this load."""

    kind: Literal["load"]
    load: Annotated[list[_Number], Field(min_length=2, max_length=3)]


class Pick(_Asked):
    """Take another equilibrium at the same inputs, by its number."""

    kind: Literal["pick"]
    number: _Count


class Release(_Asked):
    """Let an unstable equilibrium fall."""

    kind: Literal["release"]


class Folds(_Asked):
    """Tell the curves of folds in the plane of two inputs."""

    kind: Literal["folds"]


class Diagram(_Asked):
    """Make the bifurcation diagram along one input or one part of the load."""

    kind: Literal["diagram"]
    along: Literal["input", "load"]
    axis: _Axis


class Go(_Asked):
    """Take the equilibrium at a vertex of the last diagram."""

    kind: Literal["go"]
    branch: _Count
    vertex: _Count


class Export(_Asked):
    """Write the state as a picture, as data, or as lines of Python."""

    kind: Literal["export"]
    form: Literal["svg", "json", "python"]


Message = Choose | Read | Drive | Drag | Load | Pick | Release | Folds | Diagram | Go | Export
# Those that take seconds, and change nothing.
LENGTHY = (Folds, Diagram)
# Of several of these in a row only the last one matters.
PASSING = (Drive, Drag, Load)

_ADAPTER: TypeAdapter[Message] = TypeAdapter(Annotated[Message, Field(discriminator="kind")])


def message_of(text: str | bytes) -> Message:
    """Return the message of a text.

    Raises
    ------
    MessageError
        If it is none, in a sentence.
    """
    if not isinstance(text, str):
        raise MessageError("messages are text, got bytes")
    try:
        return _ADAPTER.validate_json(text)
    except ValidationError as error:
        first = error.errors(include_url=False, include_context=False, include_input=False)[0]
        place = ".".join(map(str, first["loc"]))
        raise MessageError(f"{place or 'message'}: {first['msg']}") from None
