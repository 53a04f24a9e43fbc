"""What robots believed of the source's place when the run ended, as a report shows it."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.patches import Rectangle

from taichi_plume.record.drawing import DENSITIES, logarithmic
from taichi_plume.report import look
from taichi_plume.report.maps import NAME
from taichi_plume.results.run import Run
from taichi_plume.scoring.declarations import OF_BELIEFS

WIDE, MOST, DPI = 7.2, 4, 100  # inches; groups that are shown


class BeliefAtEnd(NamedTuple):
    """Of the first robot of a group in the first trial: density (ny, nx) [1/m²] on a rectangle (left, right, low, high)
    [m].
    """

    group: str
    density: np.ndarray
    reach: tuple[float, float, float, float]


def beliefs_of(folder: Path) -> list[BeliefAtEnd]:
    """Those of a run; none where it left none. Raises RunFolderError."""
    path = folder / NAME
    if not path.exists():
        return []
    from taichi_plume.files.maps_file import opened

    with opened(path, "beliefs") as groups:
        return [_belief(group) for group in groups]


def _belief(group: Any) -> BeliefAtEnd:
    cell = float(group.attributes["cell_m"])
    x, y = group["x"][:], group["y"][:]
    p = np.asarray(group["probability"][0, 0], float)
    if p.shape != (len(y), len(x)):
        raise ValueError(f"{group.name} has a probability of {p.shape}")
    left, right, low, high = float(x[0]), float(x[-1]), float(y[0]), float(y[-1])
    reach = (left - cell / 2, right + cell / 2, low - cell / 2, high + cell / 2)
    return BeliefAtEnd(str(group.attributes["group"]), p / cell**2, reach)


def beside_sources(run: Run, beliefs: Sequence[BeliefAtEnd]) -> bytes:
    """Each belief over the arena with its sources, two in a row."""
    width, length = run.scenario.domain.extent[:2]
    columns = min(2, len(beliefs))
    rows = -(-len(beliefs) // columns)
    share = 0.86 / columns
    inches = min(share * 0.93 * WIDE / width, 4.0 / length)
    up = length * inches + 0.3
    with look.styled():
        figure = look.figure(WIDE, rows * up + 0.1, DPI)
        tall = rows * up + 0.1
        image: Any = None
        for n, one in enumerate(beliefs):
            left, top = (n % columns) * share + 0.01, 1 - ((n // columns + 1) * up) / tall
            axes = figure.add_axes((left, top, width * inches / WIDE, length * inches / tall))
            axes.set_axis_off()
            axes.add_patch(Rectangle((0, 0), width, length, facecolor="#d5dbe1", zorder=0))
            places = logarithmic(one.density, DENSITIES.low, DENSITIES.high)
            image = axes.imshow(places, cmap=look.GAS, vmin=0, vmax=1, origin="lower", extent=one.reach)
            axes.add_patch(Rectangle((0, 0), width, length, fill=False, edgecolor=look.INK, linewidth=1))
            for _, source in run.scenario.sources:
                axes.plot(
                    *source.position[:2], "*", color=look.SOURCE, markeredgecolor="white", markersize=11
                )
            axes.set_xlim(0, width)
            axes.set_ylim(0, length)
            axes.set_title(one.group, fontweight="bold", fontsize=9, loc="left", parse_math=False)
        bar = figure.add_axes((0.9, 0.08, 0.015, 0.8))
        look.scale(None, image, DENSITIES.low, DENSITIES.high, True, "1/m²", cax=bar)
        return look.png(figure)


def rows(told: Sequence[dict[str, Any]]) -> list[tuple[str, ...]]:
    """Of each group of a result how good its beliefs were at the end."""

    def text(value: Any) -> str:
        return "-" if value is None else f"{value:.3g}"

    return [(str(one["group"]), *(text(one[key]) for key in OF_BELIEFS)) for one in told]
