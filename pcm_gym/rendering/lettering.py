"""The words on a frame, written at its own resolution: label, caption and legend."""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from PIL import Image, ImageDraw, ImageFont, ImageOps

from pcm_gym.rendering.style import Colour, Style

_FONT_SIZE_MIN = 8.0
_WHITE = (255, 255, 255)


def make_legend(style: Style, unit: float, colours: Sequence[Colour], moment_max: float) -> Image.Image:
    """Return the colour bar of the bending moment with its ends, on ground that reaches a rim beyond."""
    width, bar = round(style.legend_width * unit), max(3, round(5.0 * unit))
    font = _font(style.legend_size * unit)
    entries = np.linspace(0, len(colours) - 1, width).round().astype(int)
    legend = Image.new("RGB", (width, bar + round(1.5 * style.legend_size * unit)), style.background)
    strip = np.array(colours, dtype=np.uint8)[entries]
    legend.paste(Image.fromarray(np.tile(strip, (bar, 1, 1))), (0, legend.height - bar))
    pen, row = ImageDraw.Draw(legend), legend.height - bar - round(4.0 * unit)
    ends = f"{moment_max:.2g}"
    pen.text((0, row), f"-{ends}", style.ink, font, anchor="ls")
    pen.text((width // 2, row), "moment", style.ink, font, anchor="ms")
    pen.text((width, row), ends, style.ink, font, anchor="rs")
    return ImageOps.expand(legend, round(style.legend_rim * unit), style.background)


def write_label(image: Image.Image, style: Style, unit: float, label: str, colour: Colour, *, framed: bool) -> None:
    """Write a label in the upper left corner, and draw a frame of its colour around the picture if it is to alarm."""
    pen, border = ImageDraw.Draw(image), max(2, round(style.border_width * unit))
    if framed:
        pen.rectangle((0, 0, image.width - 1, image.height - 1), None, colour, border)
    size = max(_FONT_SIZE_MIN, style.label_size * unit)
    size *= min(1.0, (image.width - 3.0 * border - size) / pen.textlength(label, _font(size)))
    font, pad = _font(size), 0.5 * size
    place = (border + pad, border + 0.75 * size)
    _, _, right, bottom = pen.textbbox(place, label, font, anchor="lm")
    pen.rounded_rectangle((-pad, -pad, right + pad, bottom + 0.6 * pad), 0.6 * pad, colour)
    pen.text(place, label, _WHITE, font, anchor="lm")


def write_caption(image: Image.Image, style: Style, unit: float, caption: str, inset: int, room: float) -> None:
    """Write a caption at the lower left, cut where it would be longer than `room` pixels."""
    pen, font = ImageDraw.Draw(image), _font(max(_FONT_SIZE_MIN, style.font_size * unit))
    shown = caption
    while len(shown) > 1 and pen.textlength(shown, font) > room:
        shown = shown.removesuffix("...")[:-1].rstrip() + "..."
    pen.text((inset, image.height - inset), shown, style.ink, font, anchor="ls")


@lru_cache(maxsize=8)
def _font(size: float) -> ImageFont.ImageFont | ImageFont.FreeTypeFont:
    return ImageFont.load_default(size)
