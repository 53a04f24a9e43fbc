"""Gas maps and belief maps (posterior of the source position) at the end of a run, read and drawn for reports."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, TypeVar

import numpy as np
from matplotlib.patches import Rectangle

from taichi_plume.observed.scales import logarithmic
from taichi_plume.record.drawing import DENSITIES
from taichi_plume.report import theme
from taichi_plume.results.run import Run
from taichi_plume.scoring.declarations import OF_BELIEFS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.image import AxesImage

NAME = "maps.zarr"
WIDE, DPI, MOST = 7.2, 100, 4  # inches; maps or beliefs that are shown
MAPS, TALLEST_MAP, LOWEST = 6.1, 6.0, 1.4  # inches: a map and its truth, side by side; a figure of them
TITLE = (2.6, 0.3)  # inches
Part = TypeVar("Part")


class MapAtEnd(NamedTuple):
    """Map of the first trial at the end of a run: estimate and truth (ny, nx) [ppm], cell [m]."""

    name: str
    cell: float
    estimate: np.ndarray
    truth: np.ndarray


class BeliefAtEnd(NamedTuple):
    """Belief of the first robot of a group in the first trial: density (ny, nx) [1/m²] on a rectangle (left, right,
    low, high) [m].
    """

    group: str
    density: np.ndarray
    reach: tuple[float, float, float, float]


def maps_of(folder: Path) -> list[MapAtEnd]:
    """Return the gas maps of a run's first trial from the run folder; [] if there are none. Raises RunFolderError."""
    return _read(folder, "maps", _map)


def beliefs_of(folder: Path) -> list[BeliefAtEnd]:
    """Return the belief maps in a run folder, one per group; [] if there are none. Raises RunFolderError."""
    return _read(folder, "beliefs", _belief)


def _read(folder: Path, kind: Literal["maps", "beliefs"], make: Callable[[Any], Part]) -> list[Part]:
    """Read each map or belief of a run folder and convert its Zarr group by `make`; return [] without the file."""
    path = folder / NAME
    if not path.exists():
        return []
    from taichi_plume.files.maps_file import opened

    with opened(path, kind) as groups:
        return [make(group) for group in groups]


def _map(group: Any) -> MapAtEnd:
    kind, x = str(group.attributes["kind"]).replace("_", " "), group["x"][:]
    estimate, truth = np.asarray(group["estimate"][0], float), np.asarray(group["truth"][0], float)
    if estimate.ndim != 2 or estimate.shape != truth.shape:
        raise ValueError(f"map {group.name} has an estimate of {estimate.shape}")
    made_by = json.loads(group.attributes["groups"])  # the first trial belongs to the first rival
    whose = f" of {made_by[0]['names'][0]}" if len(made_by) > 1 else ""
    return MapAtEnd(f"{kind} map{whose}", 2.0 * float(x[0]), estimate, truth)


def _belief(group: Any) -> BeliefAtEnd:
    cell = float(group.attributes["cell_m"])
    x, y = group["x"][:], group["y"][:]
    p = np.asarray(group["probability"][0, 0], float)
    if p.shape != (len(y), len(x)):
        raise ValueError(f"{group.name} has a probability of {p.shape}")
    left, right, low, high = float(x[0]), float(x[-1]), float(y[0]), float(y[-1])
    reach = (left - cell / 2, right + cell / 2, low - cell / 2, high + cell / 2)
    return BeliefAtEnd(str(group.attributes["group"]), p / cell**2, reach)


def beside_truth(run: Run, maps: Sequence[MapAtEnd]) -> bytes:
    """Return a PNG with each gas map's estimate on the left and the true gas on the right, on one colour scale."""
    width, length = run.scenario.domain.extent[:2]
    scale = run.scenario.recording.range_ppm
    inches = min(MAPS / (2.05 * width), TALLEST_MAP / length)  # per metre
    aside, up = max(1.05 * width, TITLE[0] / inches), length + TITLE[1] / inches
    across, tall = aside + width, len(maps) * up
    with theme.styled():
        high_up = max(tall * inches + 0.1, LOWEST)
        share = tall * inches / high_up
        figure = theme.figure(WIDE, high_up, DPI)
        axes = figure.add_axes((0.01, 1 - 0.1 / high_up - share, across * inches / WIDE, share))
        axes.set_axis_off()
        image: Any = None
        for n, gas_map in enumerate(maps):
            bottom = tall - (n + 1) * up
            titles = (f"{gas_map.name}: estimate", "truth: mean of the gas")
            for k, (values, title) in enumerate(zip((gas_map.estimate, gas_map.truth), titles, strict=True)):
                left, (rows, columns) = k * aside, values.shape
                reach = (left, left + gas_map.cell * columns, bottom, bottom + gas_map.cell * rows)
                image = _draw(axes, run, values, reach, (left, bottom), scale)
                place = (left, bottom + length + 0.02 * width)
                axes.text(*place, title, fontweight="bold", fontsize=9, parse_math=False)
        axes.set_xlim(-0.01 * width, across + 0.01 * width)
        axes.set_ylim(-0.01 * width, tall)
        bar = figure.add_axes((across * inches / WIDE + 0.025, 0.06, 0.015, 0.83))
        theme.scale(None, image, *scale, True, "ppm", cax=bar)
        return theme.png(figure)


def beside_sources(run: Run, beliefs: Sequence[BeliefAtEnd]) -> bytes:
    """Return a PNG with each belief map of the source position, and the true sources, two maps in a row."""
    width, length = run.scenario.domain.extent[:2]
    columns = min(2, len(beliefs))
    rows = -(-len(beliefs) // columns)
    share = 0.86 / columns
    inches = min(share * 0.93 * WIDE / width, 4.0 / length)
    up = length * inches + 0.3
    tall = rows * up + 0.1
    with theme.styled():
        figure = theme.figure(WIDE, tall, DPI)
        image: Any = None
        for n, belief in enumerate(beliefs):
            left, top = (n % columns) * share + 0.01, 1 - ((n // columns + 1) * up) / tall
            axes = figure.add_axes((left, top, width * inches / WIDE, length * inches / tall))
            axes.set_axis_off()
            image = _draw(axes, run, belief.density, belief.reach, (0, 0), (DENSITIES.low, DENSITIES.high))
            axes.set_xlim(0, width)
            axes.set_ylim(0, length)
            axes.set_title(belief.group, fontweight="bold", fontsize=9, loc="left", parse_math=False)
        bar = figure.add_axes((0.9, 0.08, 0.015, 0.8))
        theme.scale(None, image, DENSITIES.low, DENSITIES.high, True, "1/m²", cax=bar)
        return theme.png(figure)


def _draw(
    axes: "Axes",
    run: Run,
    values: np.ndarray,
    reach: tuple[float, float, float, float],
    corner: tuple[float, float],
    scale: tuple[float, float],
) -> "AxesImage":
    """Draw a map (ny, nx) and the sources on the floor, in logarithmic colours; corner: the floor's, on the axes."""
    width, length = run.scenario.domain.extent[:2]
    axes.add_patch(Rectangle(corner, width, length, facecolor="#d5dbe1", zorder=0))
    places = logarithmic(values, *scale)
    image = axes.imshow(places, cmap=theme.GAS, vmin=0, vmax=1, origin="lower", extent=reach)
    axes.add_patch(Rectangle(corner, width, length, fill=False, edgecolor=theme.INK, linewidth=1))
    for _, source in run.scenario.sources:
        x, y = corner[0] + source.position[0], corner[1] + source.position[1]
        axes.plot(x, y, "*", color=theme.SOURCE, markeredgecolor="white", markersize=11)
    return image


def belief_rows(groups: Sequence[dict[str, Any]]) -> list[tuple[str, ...]]:
    """Return a table row for each group of a result: name, and scores of the group's belief maps at the end."""

    def text(value: float | None) -> str:
        return "-" if value is None else f"{value:.3g}"

    return [(str(group["group"]), *(text(group[key]) for key in OF_BELIEFS)) for group in groups]
