"""The schema of mechanism files: what JSON and YAML may say of a mechanism.

It says which entries there are and of what kind; what they may be together, the classes of mechanisms themselves say.
"""

from collections.abc import Iterable, Mapping
from dataclasses import asdict
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, PositiveFloat, ValidationError

from pcm_gym.mechanism.leg import Leg, Prismatic, Revolute
from pcm_gym.mechanism.mechanism import Mechanism
from pcm_gym.mechanism.rod import Material, Rod, Round, Strip

_SCHEMA_DIALECT = "https://json-schema.org/draft/2020-12/schema"
_MOST_ERRORS_SHOWN = 3

Pair = tuple[float, float]


class FileData(BaseModel):
    """Entries are of the kind that they should be, not made so; unknown ones are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


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
    width: PositiveFloat = Field(description="Width across the plane of the mechanism, m.")
    thickness: PositiveFloat = Field(description="Thickness in the plane, m; at most the width.")

    def made(self) -> Strip:
        """Return the section."""
        return Strip(self.width, self.thickness)


class MaterialData(FileData):
    """A linearly elastic material."""

    modulus: PositiveFloat = Field(description="Young's modulus, Pa.")
    yield_stress: PositiveFloat = Field(description="Greatest stress that leaves no trace, Pa.")
    density: PositiveFloat = Field(description="Density, kg/m^3.")

    def made(self) -> Material:
        """Return the material."""
        return Material(self.modulus, self.yield_stress, self.density)


class RodData(FileData):
    """A slender, inextensible, initially straight elastic rod."""

    length: PositiveFloat = Field(description="Length, m.")
    bending_stiffness: PositiveFloat | None = Field(
        default=None, description="Bending stiffness EI, N m^2; 1 by default, or that of section and material."
    )
    section: Annotated[RoundData | StripData, Field(discriminator="kind")] | None = Field(
        default=None, description="Cross-section, with a material."
    )
    material: MaterialData | None = Field(default=None, description="Material, with a section.")

    def made(self) -> Rod:
        """Return the rod."""
        section, material = self.section and self.section.made(), self.material and self.material.made()
        return Rod(self.length, self.bending_stiffness, section, material)


class RevoluteData(FileData):
    """A motor that turns the clamp about its base point; its input is an angle, rad."""

    kind: Literal["revolute"]
    base: Pair = Field(description="The clamped point (x, y), m.")
    clamp_angle: float = Field(default=0.0, description="World angle of the clamp at input 0, rad.")
    limits: Pair = Field(default=Revolute.limits, description="Range (lower, upper) of the input, rad.")

    def made(self) -> Revolute:
        """Return the motor."""
        return Revolute(self.base, self.clamp_angle, self.limits)


class PrismaticData(FileData):
    """A slider that moves the clamp along an axis; its input is a distance, m."""

    kind: Literal["prismatic"]
    base: Pair = Field(description="The clamped point (x, y) at input 0, m.")
    axis_angle: float = Field(description="World angle of the axis, rad.")
    clamp_angle: float = Field(description="World angle at which the rod leaves the clamp, rad.")
    limits: Pair = Field(default=Prismatic.limits, description="Range (lower, upper) of the input, m.")

    def made(self) -> Prismatic:
        """Return the slider."""
        return Prismatic(self.base, self.axis_angle, self.clamp_angle, self.limits)


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
    for leg, entry in zip(mechanism.legs, content["legs"], strict=True):
        entry["actuator"] = _named(leg.actuator, entry["actuator"])
        entry["rod"] = _rod_data(leg.rod, entry["rod"])
    if mechanism.reference is not None:
        content["reference"] = _rod_data(mechanism.reference, content["reference"])
    return content


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
    return f"{place}: {error['msg']}" if place else str(error["msg"])


def _named(part: object, entry: dict[str, Any]) -> dict[str, Any]:
    """Return the entries of a part that may be of several kinds, with its kind before them."""
    return {"kind": type(part).__name__.lower(), **entry}


def _rod_data(rod: Rod, entry: dict[str, Any]) -> dict[str, Any]:
    return entry if rod.section is None else {**entry, "section": _named(rod.section, entry["section"])}
