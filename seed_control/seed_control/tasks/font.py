# SPDX-License-Identifier: Apache-2.0
"""Text as pen strokes, in the single-stroke fonts of Hershey (library Hershey-Fonts)."""

from typing import Any

from seed_core.config import ConfigError
from seed_core.program.suggestions import did_you_mean

Point = tuple[float, float]
_TOLERANCE = 0.01  # of the height: points of a stroke that are nearer to each other are one


class FontError(ConfigError):
    """A text that cannot be written."""


def check_text(text: str, font: str) -> Any:
    """The library's writer with this font. Raises FontError: as `strokes_of_text`, which needs it."""
    try:
        from HersheyFonts import HersheyFonts  # type: ignore[import-untyped]
    except ImportError as error:
        raise FontError("writing needs the library Hershey-Fonts: pip install Hershey-Fonts==2.1.0") from error
    writer = HersheyFonts()
    if font not in writer.default_font_names:
        meant = did_you_mean(font, writer.default_font_names)
        raise FontError(f"font '{font}' is unknown; known: {', '.join(writer.default_font_names)}{meant}", "font")
    writer.load_default_font(font)
    for character in sorted(set(text) - {" "}):
        if not character.isascii() or not list(writer.strokes_for_text(character)):
            words = f"text = '{text:.60}': font '{font}' has no strokes for '{character}'"
            raise FontError(f"{words}: leave it out, or name another font", "text")
    if not text.strip(" "):
        raise FontError(f"text = '{text:.60}' has nothing to write: give more than spaces", "text")
    return writer


def strokes_of_text(text: str, height: float, origin: Point = (0.0, 0.0), font: str = "futural") -> list[list[Point]]:
    """Polylines (x, y) [m] of a text.

    Args:
        text: printable characters of the font (ASCII).
        height: of capital letters [m].
        origin: start of the base line [m].

    Raises:
        FontError: unknown font, a character without strokes, nothing to write, or the library is missing.
    """
    writer = check_text(text, font)
    options = writer.render_options  # the font's y points downwards, from its capitals' line to its base line
    scale = height / (options.base_line - options.cap_line)
    options.scalex, options.scaley, options.yofs = scale, -scale, origin[1] + scale * options.base_line
    strokes = [[(float(x), float(y)) for x, y in stroke] for stroke in writer.strokes_for_text(text)]
    left = min(x for s in strokes for x, _ in s) - origin[0]
    return [_thinned([(x - left, y) for x, y in s], _TOLERANCE * height) for s in strokes]


def _thinned(points: list[Point], least: float) -> list[Point]:
    out = points[:1]
    for p in points[1:]:
        if (p[0] - out[-1][0]) ** 2 + (p[1] - out[-1][1]) ** 2 > least * least:
            out.append(p)
    return out if len(out) > 1 else [points[0], (points[0][0] + least, points[0][1])]  # a dot is a short dash
