"""An equilibrium as a drawing in lines, SVG: the same parts and colours as the frames, sharp at any size."""

import math
from collections.abc import Sequence
from xml.etree import ElementTree

import numpy as np
from numpy.typing import ArrayLike

from pcm_gym.mechanism.validation import instance_of, sequence_of, whole_number
from pcm_gym.rendering.camera import Camera, rail_ends, reach_bounds
from pcm_gym.rendering.polylines import equilibrium_polylines
from pcm_gym.rendering.style import Paint, Style
from pcm_gym.solving import Equilibrium

_SIZE_MIN, _SIZE_MAX = 64, 1 << 16
_STYLE_SIZE = 480.0
_MARGIN = 18.0
_POINTS = 200


def equilibrium_svg(
    equilibrium: Equilibrium, size: int = 480, ghosts: Sequence[Equilibrium] = (), style: Style | None = None
) -> str:
    """Return the drawing of an equilibrium as SVG, in which places are exact to a hundredth of a pixel.

    Parameters
    ----------
    equilibrium : Equilibrium
        An unstable one is drawn in the style's alarm colour.
    size : int
        Width and height, pixels.
    ghosts : sequence of Equilibrium
        Others, faint behind it: stable ones solid, unstable ones dashed.
    style : Style, optional

    Raises
    ------
    TypeError, ValueError
        If an argument is of the wrong kind or size.
    """
    instance_of("equilibrium", equilibrium, Equilibrium)
    others = sequence_of("ghosts", ghosts, Equilibrium)
    style = Style() if style is None else instance_of("style", style, Style)
    drawing = _Drawing(equilibrium, whole_number("size", size, least=_SIZE_MIN, most=_SIZE_MAX), style)
    for other in others:
        drawing.add_ghost(other)
    drawing.add_mechanism()
    return drawing.text()


class _Drawing:
    """The elements of one drawing."""

    def __init__(self, equilibrium: Equilibrium, size: int, style: Style) -> None:
        self._equilibrium, self._style, self._unit = equilibrium, style, size / _STYLE_SIZE
        self._camera = Camera.fit(reach_bounds(equilibrium.mechanism), (size, size), _MARGIN * self._unit)
        sides = {"width": str(size), "height": str(size)}
        box = {"viewBox": f"0 0 {size} {size}", "xmlns": "http://www.w3.org/2000/svg"}
        self._root = ElementTree.Element("svg", sides | box)
        ElementTree.SubElement(self._root, "title").text = repr(equilibrium)
        self._add("rect", sides | {"fill": hex_colour(style.background)})

    def text(self) -> str:
        return ElementTree.tostring(self._root, encoding="unicode") + "\n"

    def add_ghost(self, ghost: Equilibrium) -> None:
        style = self._style
        dashes = (
            {} if ghost.is_stable else {"stroke-dasharray": " ".join(f"{n * self._unit:g}" for n in style.ghost_dashes)}
        )
        for rod in equilibrium_polylines(ghost, _POINTS).rods:
            self._line(rod, style.ghost, style.ghost_width, dashes)

    def add_mechanism(self) -> None:
        style, lines = self._style, equilibrium_polylines(self._equilibrium, _POINTS)
        for leg, base in zip(self._equilibrium.mechanism.legs, lines.clamps, strict=True):
            if leg.actuator.rail_angle is None:
                self._disc(base, style.motor_radius, style.metal_light, style.metal)
            else:
                self._line(rail_ends(leg), style.metal_light, 4.0)
        if self._equilibrium.mechanism.dof == 3:
            self._polygon(lines.platform, style.platform, style.metal)
        colour = style.moment_zero if self._equilibrium.is_stable else style.alarm
        for rod, angle in zip(lines.rods, lines.clamp_angles.tolist(), strict=True):
            self._line(rod, colour, style.rod_width)
            along = style.clamp_length * self._unit / self._camera.scale * np.array([math.cos(angle), math.sin(angle)])
            self._line([rod[0] - 0.3 * along, rod[0] + 0.7 * along], style.metal, style.clamp_width)
        for hinge in lines.hinges:
            self._disc(hinge, style.hinge_radius, style.background, style.ink)
        self._disc(lines.end_effector, style.hinge_radius + 1.2, style.ink, style.background)

    def _line(self, points: ArrayLike, paint: Paint, width: float, more: dict[str, str] | None = None) -> None:
        stroke = {"fill": "none", "stroke": hex_colour(paint), "stroke-width": f"{width * self._unit:g}"}
        self._add("polyline", {"points": self._corners(points), **stroke, **(more or {})})

    def _polygon(self, points: ArrayLike, fill: Paint, edge: Paint) -> None:
        opacity = {"fill-opacity": f"{fill[3] / 255.0:.3g}"} if len(fill) == 4 else {}
        width = f"{self._style.outline_width * self._unit:g}"
        stroke = {"fill": hex_colour(fill), "stroke": hex_colour(edge), "stroke-width": width}
        self._add("polygon", {"points": self._corners(points), **stroke, **opacity})

    def _disc(self, centre: ArrayLike, radius: float, fill: Paint, edge: Paint) -> None:
        x, y = self._camera.pixels(centre).tolist()
        place = {"cx": f"{x:.2f}", "cy": f"{y:.2f}", "r": f"{radius * self._unit:g}"}
        width = f"{self._style.outline_width * self._unit:g}"
        self._add("circle", {**place, "fill": hex_colour(fill), "stroke": hex_colour(edge), "stroke-width": width})

    def _corners(self, points: ArrayLike) -> str:
        return " ".join(f"{x:.2f},{y:.2f}" for x, y in self._camera.pixels(points).tolist())

    def _add(self, kind: str, attributes: dict[str, str]) -> None:
        ElementTree.SubElement(self._root, kind, attributes)


def hex_colour(paint: Paint) -> str:
    """Return the colour of a paint as SVG takes it."""
    return f"#{paint[0]:02x}{paint[1]:02x}{paint[2]:02x}"
