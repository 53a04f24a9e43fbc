"""Palette: the colours of things in reports, pictures, films, recordings and the drawn room, as "#rrggbb".

Colours of robots, of states and of declarations differ from each other for usual vision and for protanopia,
deuteranopia and tritanopia, on light and on dark ground. `tests/report/test_palette.py` has the least differences
(CIEDE2000).
"""

from collections.abc import Iterable

from taichi_plume.scenario.vocabulary import Color

ROBOTS = ("#0014ff", "#89c489", "#ff9dff", "#277662", "#76769d", "#7676ff", "#76149d", "#3b9d89")
"""Colours of robots, by the number of a robot in a trial; the first few differ most."""
STATES = ("#761400", "#ebb1ff", "#898914", "#76009d", "#277662", "#27d8b1", "#c4d814", "#c43bff")
"""Colours of the states of algorithms; no algorithm has more states."""
FOUND, WRONG = "#009e73", "#d55e00"
"""Robots that have found a source, and right declarations; wrong declarations (Okabe and Ito 2008)."""
SOURCE, SOLID, PROBE = "#d81b60", "#a7b0bb", "#6a51a3"
WARM, COOL = "#f0683c", "#3d8fd1"
"""Heaters and walls warmer than the air; cooler ones."""
INLET, HONEYCOMB, OUTLET, MOVING_WALL, OPENING = "#4fc3f7", "#ffd54f", "#81c784", "#ce93d8", "#90a4ae"
"""Kinds of openings, OPENING for all others; screens have the colour of honeycombs."""


def rgb(color: str) -> Color:
    """Return the bytes of red, green and blue of a colour "#rrggbb"."""
    red, green, blue = bytes.fromhex(color[1:])
    return red, green, blue


def robot_color(number: int) -> str:
    """Return the colour of a robot; number: of the robot in a trial, counted through the groups. Colours repeat."""
    return ROBOTS[number % len(ROBOTS)]


def state_colors(names: Iterable[str]) -> dict[str, str]:
    """Return the colour of each state by name; names: states of all groups in their order. Colours repeat."""
    return {name: STATES[k % len(STATES)] for k, name in enumerate(dict.fromkeys(names))}
