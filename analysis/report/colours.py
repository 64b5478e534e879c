"""The page's colours by day and by night: those of the figures become CSS variables, each with a value for the dark.

Greys are turned round, black to near white; colours keep their hue and become light enough for the dark ground.
"""

import colorsys
import re

from matplotlib.colors import to_hex, to_rgb

NIGHT, NIGHT_INK = "#14181d", 0.93  # the ground of the dark page, and the lightest grey on it
LEAST = 4.5  # contrast of a colour with the dark ground


def as_variables(svg: str) -> str:
    """An SVG whose colours are the variables that `variables` defines."""
    return re.sub(r"(stroke|fill): (#[0-9a-f]{6})\b", lambda found: f"{found[1]}: {variable(found[2])}", svg)


def variable(colour: str) -> str:
    """A colour as it is written in a style."""
    return f"var(--c{colour.removeprefix('#')})"


def variables(markup: str) -> tuple[str, str]:
    """CSS that defines the variables of some markup, by day and by night."""
    used = sorted(set(re.findall(r"var\(--c([0-9a-f]{6})\)", markup)))
    day = " ".join(f"--c{colour}: #{colour};" for colour in used)
    night = " ".join(f"--c{colour}: {by_night('#' + colour)};" for colour in used)
    return day, night


def by_night(colour: str) -> str:
    """The colour in the dark that stands for one in the light."""
    hue, light, saturation = colorsys.rgb_to_hls(*to_rgb(colour))
    if saturation < 0.05:
        ground = colorsys.rgb_to_hls(*to_rgb(NIGHT))[1]
        grey = ground + (NIGHT_INK - ground) * (1 - light)
        return to_hex((grey, grey, grey)) if light < 1 else NIGHT
    while contrast(found := to_hex(colorsys.hls_to_rgb(hue, light, saturation)), NIGHT) < LEAST:
        light += 0.02
    return found


def contrast(one: str, other: str) -> float:
    """The contrast of two colours, 1 to 21, as of the Web Content Accessibility Guidelines 2.1."""
    low, high = sorted((_luminance(one), _luminance(other)))
    return (high + 0.05) / (low + 0.05)


def _luminance(colour: str) -> float:
    r, g, b = (c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in to_rgb(colour))
    return 0.2126 * r + 0.7152 * g + 0.0722 * b
