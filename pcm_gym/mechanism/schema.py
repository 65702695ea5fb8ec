"""The schema of mechanism files: what JSON and YAML may say of a mechanism.

It says which entries there are and of what kind; what they may be together, the classes of mechanisms themselves say.
"""

from collections.abc import Iterable, Mapping
from dataclasses import asdict
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, PositiveFloat, ValidationError, model_validator

from pcm_gym.mechanism.leg import Leg, Prismatic, Revolute
from pcm_gym.mechanism.materials import FIBREGLASS, NITINOL, SPRING_STEEL
from pcm_gym.mechanism.mechanism import Mechanism
from pcm_gym.mechanism.rod import Material, Rod, Round, Strip

_SCHEMA_DIALECT = "https://json-schema.org/draft/2020-12/schema"
_MOST_ERRORS_SHOWN = 3

_MATERIALS = {"SPRING_STEEL": SPRING_STEEL, "NITINOL": NITINOL, "FIBREGLASS": FIBREGLASS, None: None}

Pair = tuple[float, float]


class FileData(BaseModel):
    """Entries are of the kind that they should be, not made so; unknown ones are refused.

    What a part is made of is refused by its own class, and here it is said in which entry.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)

    def made(self) -> Any:
        """Return what the entries describe."""
        raise NotImplementedError

    @model_validator(mode="after")
    def _check_made(self) -> Self:
        try:
            self.made()
        except TypeError as error:
            raise ValueError(str(error)) from error
        return self


class RoundData(FileData):
    """A solid round cross-section."""

    kind: Literal["round"]
    radius: PositiveFloat = Field(description="Radius, m.")

    def made(self) -> Round:
        """Return the section."""
        return Round(self.radius)


class StripData(FileData):
    """A rectangular cross-section that bends about its thin axis."""

    kind: Literal["strip"]
    width: PositiveFloat = Field(description="Across the plane, m.")
    thickness: PositiveFloat = Field(description="In the plane, m.")

    def made(self) -> Strip:
        """Return the section."""
        return Strip(self.width, self.thickness)


class MaterialData(FileData):
    """A linearly elastic material, and where its elastic range ends."""

    modulus: PositiveFloat = Field(description="Young's modulus, Pa.")
    yield_stress: PositiveFloat = Field(description="Greatest stress that leaves no trace, Pa.")
    density: PositiveFloat = Field(description="Density, kg/m^3.")

    def made(self) -> Material:
        """Return the material."""
        return Material(self.modulus, self.yield_stress, self.density)


class RodData(FileData):
    """A slender, inextensible, initially straight elastic rod: by its stiffness, or by its section and material."""

    length: PositiveFloat = Field(description="Length, m.")
    bending_stiffness: PositiveFloat | None = Field(
        default=None,
        description="Bending stiffness EI, N m^2; beside a section left out, or what it makes.",
    )
    section: Annotated[RoundData | StripData, Field(discriminator="kind")] | None = None
    material: MaterialData | Literal["SPRING_STEEL", "NITINOL", "FIBREGLASS"] | None = Field(
        default=None, description="A material by its numbers, or one that pcm_gym names."
    )

    def made(self) -> Rod:
        """Return the rod."""
        if self.bending_stiffness is None and self.section is None:
            raise ValueError("a rod must have a bending_stiffness, or a section and a material")
        section = None if self.section is None else self.section.made()
        material = self.material.made() if isinstance(self.material, MaterialData) else _MATERIALS.get(self.material)
        return Rod(self.length, self.bending_stiffness, section, material)  # type: ignore[arg-type]  # it checks


class RevoluteData(FileData):
    """A motor that turns the clamp about its base point; its input is an angle, rad."""

    kind: Literal["revolute"]
    base: Pair = Field(description="The clamped point (x, y), m.")
    clamp_angle: float = Field(default=0.0, description="World angle of the clamp at input 0, rad.")
    limits: Pair = Field(default=Revolute.limits, description="Range (lower, upper) of the input, rad.")
    greatest_torque: PositiveFloat | None = Field(default=None, description="Greatest moment to either side, N m.")

    def made(self) -> Revolute:
        """Return the motor."""
        return Revolute(self.base, self.clamp_angle, self.limits, self.greatest_torque)


class PrismaticData(FileData):
    """A slider that moves the clamp along an axis; its input is a distance, m."""

    kind: Literal["prismatic"]
    base: Pair = Field(description="The clamped point (x, y) at input 0, m.")
    axis_angle: float = Field(description="World angle of the axis, rad.")
    clamp_angle: float = Field(description="World angle at which the rod leaves the clamp, rad.")
    limits: Pair = Field(default=Prismatic.limits, description="Range (lower, upper) of the input, m.")
    greatest_force: PositiveFloat | None = Field(default=None, description="Greatest force to either side, N.")

    def made(self) -> Prismatic:
        """Return the slider."""
        return Prismatic(self.base, self.axis_angle, self.clamp_angle, self.limits, self.greatest_force)


class LegData(FileData):
    """An actuator, the rod clamped to it, and the hinge that joins the rod's tip to the end-effector."""

    actuator: Annotated[RevoluteData | PrismaticData, Field(discriminator="kind")]
    rod: RodData
    attachment: Pair = Field(default=Leg.attachment, description="The hinge (x, y) in the end-effector's frame, m.")

    def made(self) -> Leg:
        """Return the leg."""
        return Leg(self.actuator.made(), self.rod.made(), self.attachment)


class MechanismData(FileData):
    """A planar parallel continuum mechanism: legs around one end-effector. Lengths are in m, angles in rad."""

    name: str = Field(min_length=1)
    legs: Annotated[list[LegData], Field(min_length=2, max_length=3)] = Field(
        description="Two whose hinges are at the end-effector's origin, a point; or three, a platform."
    )
    home_inputs: list[float] | None = Field(
        default=None, description="Actuator inputs at home; the middle of the limits by default."
    )
    home_pose: list[float] | None = Field(
        default=None,
        description="The stable equilibrium nearest to this pose, (x, y) or (x, y, phi), is home; "
        "the one of least energy by default.",
    )
    description: str = ""
    reference: RodData | None = Field(
        default=None, description="Rod that is the unit of dimensionless numbers; the mean of the rods by default."
    )

    def made(self) -> Mechanism:
        """Return the mechanism."""
        return Mechanism(
            name=self.name,
            legs=tuple(leg.made() for leg in self.legs),
            home_inputs=None if self.home_inputs is None else tuple(self.home_inputs),
            home_pose=None if self.home_pose is None else tuple(self.home_pose),
            description=self.description,
            reference=None if self.reference is None else self.reference.made(),
        )


def mechanism_schema() -> dict[str, Any]:
    """Return the JSON schema of mechanism files, in JSON and in YAML alike."""
    return {"$schema": _SCHEMA_DIALECT, **MechanismData.model_json_schema()} | {"title": "Mechanism"}


def data_from_mechanism(mechanism: Mechanism) -> dict[str, Any]:
    """Return a mechanism as entries of its file, every number in full; what has a default is there too."""
    content = asdict(mechanism)
    rods = [(leg.rod, entry["rod"]) for leg, entry in zip(mechanism.legs, content["legs"], strict=True)]
    if mechanism.reference is not None:
        rods.append((mechanism.reference, content["reference"]))
    for rod, entry in rods:
        if rod.section is not None:
            entry["section"] = _with_kind(rod.section, entry["section"])
    for leg, entry in zip(mechanism.legs, content["legs"], strict=True):
        entry["actuator"] = _with_kind(leg.actuator, entry["actuator"])
    return content


def _with_kind(part: object, entries: dict[str, Any]) -> dict[str, Any]:
    return {"kind": type(part).__name__.lower(), **entries}


def mechanism_from_text(text: str) -> Mechanism:
    """Return the mechanism of a JSON text.

    Raises
    ------
    ValueError
        If the text is no JSON, or no mechanism; it says why, entry by entry.
    """
    try:
        data = MechanismData.model_validate_json(text)
    except ValidationError as error:
        raise ValueError(_in_words(error.errors(include_url=False, include_input=False))) from None
    return data.made()


def _in_words(errors: Iterable[Any]) -> str:
    found = [_sentence(error) for error in errors]
    more = f"; and {len(found) - _MOST_ERRORS_SHOWN} more" if len(found) > _MOST_ERRORS_SHOWN else ""
    return "; ".join(found[:_MOST_ERRORS_SHOWN]) + more


def _sentence(error: Mapping[str, Any]) -> str:
    place = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in error["loc"]).lstrip(".")
    reason = str(error["msg"]).removeprefix("Value error, ")
    return f"{place}: {reason}" if place else reason
