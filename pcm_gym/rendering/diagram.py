"""A bifurcation diagram as a drawing in lines, SVG: stable branches solid, unstable ones dashed."""

import math
from xml.etree import ElementTree

import numpy as np

from pcm_gym.arrays import Array
from pcm_gym.mechanism.validation import instance_of, one_of
from pcm_gym.rendering.style import Style
from pcm_gym.rendering.vector import hex_colour
from pcm_gym.solving import BifurcationDiagram, DiagramBranch, SpecialKind

_WIDTH, _HEIGHT = 760, 460
_LEFT, _RIGHT, _TOP, _BOTTOM = 76, 20, 30, 52
_COORDINATES = ("x", "y", "phi")
_RIM, _TICKS = 0.05, 6
_DASHES = "6 5"
_UNITS = {"energy": "J", "x": "m", "y": "m", "phi": "rad"}


def diagram_svg(diagram: BifurcationDiagram, ordinate: str = "energy", style: Style | None = None) -> str:
    """Return the drawing of a diagram as SVG.

    Parameters
    ----------
    diagram : BifurcationDiagram
    ordinate : "energy", "x", "y" or "phi"
        What is drawn over the fraction of the way.
    style : Style, optional

    Raises
    ------
    TypeError, ValueError
        If an argument is of the wrong kind, or the mechanism has no such coordinate.
    """
    instance_of("diagram", diagram, BifurcationDiagram)
    known = ("energy", *_COORDINATES[: diagram.mechanism.dof])
    ordinate = one_of("ordinate", ordinate, known)
    style = Style() if style is None else instance_of("style", style, Style)
    return _Drawing(diagram, ordinate, style).text()


class _Drawing:
    """The elements of one drawing."""

    def __init__(self, diagram: BifurcationDiagram, ordinate: str, style: Style) -> None:
        self._ordinate, self._style = ordinate, style
        heights = [self._heights(branch) for branch in diagram.branches] or [np.zeros(1)]
        low, high = float(min(map(np.min, heights))), float(max(map(np.max, heights)))
        rim = _RIM * (high - low) or 1.0
        self._low, self._high = low - rim, high + rim
        box = {"viewBox": f"0 0 {_WIDTH} {_HEIGHT}", "xmlns": "http://www.w3.org/2000/svg"}
        self._root = ElementTree.Element("svg", {"width": str(_WIDTH), "height": str(_HEIGHT), **box})
        ElementTree.SubElement(self._root, "title").text = repr(diagram).splitlines()[0]
        self._add("rect", {"width": str(_WIDTH), "height": str(_HEIGHT), "fill": hex_colour(style.background)})
        self._axes()
        for branch, own in zip(diagram.branches, heights, strict=True):
            for first, last in branch.pieces():
                is_stable = branch.index_of((first, last)) == 0
                self._line(branch.fractions[first : last + 1], own[first : last + 1], is_stable)
        for point in diagram.points:
            number, vertex = point.branches[0]
            self._mark(point.fraction, float(heights[number][vertex]), point.kind)

    def text(self) -> str:
        return ElementTree.tostring(self._root, encoding="unicode") + "\n"

    def _heights(self, branch: DiagramBranch) -> Array:
        if self._ordinate == "energy":
            return branch.energies
        return branch.poses[:, _COORDINATES.index(self._ordinate)]

    def _x(self, fraction: Array | float) -> Array:
        return np.asarray(_LEFT + np.asarray(fraction) * (_WIDTH - _LEFT - _RIGHT))

    def _y(self, height: Array | float) -> Array:
        part = (np.asarray(height) - self._low) / (self._high - self._low)
        return np.asarray(_HEIGHT - _BOTTOM - part * (_HEIGHT - _TOP - _BOTTOM))

    def _axes(self) -> None:
        grey = {"fill": hex_colour(self._style.ink), "font-size": "13", "font-family": "sans-serif"}
        rule = {"stroke": hex_colour(self._style.grid)}
        for value in _ticks(0.0, 1.0):
            x = f"{self._x(value):.1f}"
            self._add("line", {"x1": x, "x2": x, "y1": str(_TOP), "y2": str(_HEIGHT - _BOTTOM), **rule})
            self._add(
                "text", {"x": x, "y": str(_HEIGHT - _BOTTOM + 18), "text-anchor": "middle", **grey}, f"{value:.3g}"
            )
        for value in _ticks(self._low, self._high):
            y = float(self._y(value))
            self._add(
                "line", {"x1": str(_LEFT), "x2": str(_WIDTH - _RIGHT), "y1": f"{y:.1f}", "y2": f"{y:.1f}", **rule}
            )
            self._add("text", {"x": str(_LEFT - 8), "y": f"{y + 4:.1f}", "text-anchor": "end", **grey}, f"{value:.4g}")
        middle = {"x": f"{self._x(0.5):.1f}", "y": str(_HEIGHT - 12), "text-anchor": "middle"}
        self._add("text", {**middle, **grey}, "part of the way")
        self._add("text", {"x": "10", "y": "18", **grey}, f"{self._ordinate}, {_UNITS[self._ordinate]}")

    def _line(self, fractions: Array, heights: Array, is_stable: bool) -> None:
        corners = " ".join(f"{x:.2f},{y:.2f}" for x, y in zip(self._x(fractions), self._y(heights), strict=True))
        colour = hex_colour(self._style.moment_zero if is_stable else self._style.alarm)
        dashes = {} if is_stable else {"stroke-dasharray": _DASHES}
        width = "2.2" if is_stable else "1.3"
        self._add("polyline", {"points": corners, "fill": "none", "stroke": colour, "stroke-width": width, **dashes})

    def _mark(self, fraction: float, height: float, kind: SpecialKind) -> None:
        place = {"cx": f"{self._x(fraction):.2f}", "cy": f"{self._y(height):.2f}", "r": "4"}
        ink, paper = hex_colour(self._style.ink), hex_colour(self._style.background)
        fill = paper if kind is SpecialKind.FOLD else ink
        mark = self._add("circle", {**place, "fill": fill, "stroke": ink, "stroke-width": "1.4"})
        ElementTree.SubElement(mark, "title").text = str(kind)

    def _add(self, kind: str, attributes: dict[str, str], text: str | None = None) -> ElementTree.Element:
        element = ElementTree.SubElement(self._root, kind, attributes)
        element.text = text
        return element


def _ticks(low: float, high: float) -> Array:
    """Return round values between two others, 1, 2 or 5 times a power of ten apart."""
    wanted = (high - low) / _TICKS
    power = 10.0 ** math.floor(math.log10(wanted))
    step = power * next(factor for factor in (1.0, 2.0, 5.0, 10.0) if factor * power >= wanted * (1.0 - 1e-12))
    return step * np.arange(math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9) + 1, dtype=np.float64)
