"""Rods, and what they may be made of: a section and a material."""

import math
from dataclasses import dataclass, replace
from typing import cast

from pcm_gym.mechanism.validation import number_not_negative, positive_number, shown


@dataclass(frozen=True)
class Round:
    """A solid round cross-section.

    Parameters
    ----------
    radius : float
        In m, greater than 0.
    """

    radius: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "radius", positive_number("radius", self.radius))

    @property
    def second_moment(self) -> float:
        """Second moment of area I about the axis of bending, pi r^4 / 4, in m^4."""
        return 0.25 * math.pi * self.radius**4

    @property
    def half_height(self) -> float:
        """Distance of the outermost fibre from the neutral axis, in m."""
        return self.radius

    @property
    def area(self) -> float:
        """Area of the cross-section, in m^2."""
        return math.pi * self.radius**2


@dataclass(frozen=True)
class Strip:
    """A rectangular cross-section that bends about its thin axis, its width across the plane of the mechanism.

    Beam theory: that a strip much wider than thick is stiffer, by up to 1 / (1 - Poisson's ratio^2), is left out.

    Parameters
    ----------
    width : float
        Across the plane, in m; at least the thickness.
    thickness : float
        In the plane, in m, greater than 0.

    Raises
    ------
    TypeError, ValueError
        If a size is no positive number, or the strip thicker than wide.
    """

    width: float
    thickness: float

    def __post_init__(self) -> None:
        for name in ("width", "thickness"):
            object.__setattr__(self, name, positive_number(name, getattr(self, name)))
        if self.thickness > self.width:
            raise ValueError(
                "thickness must be at most the width, because a strip bends about its thin axis; "
                f"got thickness {self.thickness} and width {self.width}"
            )

    @property
    def second_moment(self) -> float:
        """Second moment of area I about the axis of bending, width thickness^3 / 12, in m^4."""
        return self.width * self.thickness**3 / 12.0

    @property
    def half_height(self) -> float:
        """Distance of the outermost fibre from the neutral axis, in m."""
        return 0.5 * self.thickness

    @property
    def area(self) -> float:
        """Area of the cross-section, in m^2."""
        return self.width * self.thickness


Section = Round | Strip


@dataclass(frozen=True)
class Material:
    """A linearly elastic material, and where its elastic range ends.

    Parameters
    ----------
    modulus : float
        Young's modulus E in Pa, greater than 0.
    yield_stress : float
        Greatest stress that leaves no trace, in Pa, greater than 0: of a metal the yield strength, of a composite the
        bending strength, of a superelastic alloy the stress at which its transformation begins.
    density : float
        In kg/m^3, greater than 0. It serves for masses: gravity on the rods is not modelled.
    """

    modulus: float
    yield_stress: float
    density: float

    def __post_init__(self) -> None:
        for name in ("modulus", "yield_stress", "density"):
            object.__setattr__(self, name, positive_number(name, getattr(self, name)))


@dataclass(frozen=True)
class Rod:
    """A slender, inextensible, initially straight elastic rod of constant cross-section.

    What it does follows from its length and its bending stiffness EI. The stiffness is given as such, or follows from a
    section and a material, which also tell what the rod endures: ``Rod(1.0, section=Strip(0.02, 0.0005),
    material=SPRING_STEEL)``.

    Parameters
    ----------
    length : float
        Length L in m, greater than 0.
    bending_stiffness : float, optional
        EI in N m^2, greater than 0; 1 by default, or that of section and material.
    section : Round or Strip, optional
        The cross-section; it takes a material.
    material : Material, optional
        What the rod is made of; it takes a section.

    Raises
    ------
    TypeError, ValueError
        If a part is of the wrong kind or range, section and material are not both given, or another bending stiffness
        is given beside them.
    """

    length: float = 1.0
    bending_stiffness: float = None  # type: ignore[assignment]  # a number from the constructor on
    section: Section | None = None
    material: Material | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "length", positive_number("length", self.length))
        object.__setattr__(self, "bending_stiffness", self._stiffness())

    def _stiffness(self) -> float:
        given = cast("float | None", self.bending_stiffness)
        if self.section is None and self.material is None:
            return 1.0 if given is None else positive_number("bending_stiffness", given)
        if not isinstance(self.section, Section):
            raise TypeError(f"section must be a Round or a Strip where a material is given, got {shown(self.section)}")
        if not isinstance(self.material, Material):
            raise TypeError(f"material must be a Material where a section is given, got {shown(self.material)}")
        own = self.material.modulus * self.section.second_moment
        if not 0.0 < own < math.inf:
            raise ValueError(
                f"section and material must make a bending stiffness that double precision holds, got {own}"
            )
        # copies of a rod come with the stiffness that it has
        if given is not None and positive_number("bending_stiffness", given) != own:
            raise ValueError(
                f"bending_stiffness must be left out beside section and material, which make {own}; got {given}"
            )
        return own

    @property
    def yield_curvature(self) -> float:
        """Curvature at which the outermost fibre is at the yield stress, in 1/m; nan without section and material.

        In bending alone: the stress is E times curvature times the fibre's distance from the neutral axis. The mean
        axial stress, smaller by the slenderness of the rod, is left out, as the rod is inextensible.
        """
        if self.section is None or self.material is None:
            return math.nan
        return self.material.yield_stress / (self.material.modulus * self.section.half_height)

    def stress_ratio(self, curvature: float) -> float:
        """Return the bending stress at a curvature, 1/m, over the yield stress; nan without section and material."""
        return number_not_negative("curvature", curvature) / self.yield_curvature

    @property
    def mass(self) -> float:
        """Mass in kg; nan without section and material."""
        if self.section is None or self.material is None:
            return math.nan
        return self.material.density * self.section.area * self.length

    def scaled(self, length: float, stiffness: float) -> "Rod":
        """Return the rod with length and bending stiffness times these factors; of one with a material its modulus."""
        length = self.length * positive_number("length", length)
        stiffness = positive_number("stiffness", stiffness)
        if self.material is None:
            return Rod(length, self.bending_stiffness * stiffness)
        material = replace(self.material, modulus=self.material.modulus * stiffness)
        return Rod(length, section=self.section, material=material)
