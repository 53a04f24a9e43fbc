"""Gas maps and belief maps (posterior of the source position) at the end of a run, read and drawn for reports."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple, TypeVar

import numpy as np
from matplotlib.patches import Rectangle

from taichi_plume.observed.scales import logarithmic, rounded_up, slices
from taichi_plume.record.drawing import DENSITIES
from taichi_plume.report import theme
from taichi_plume.results.run import Run
from taichi_plume.scoring.declarations import OF_BELIEFS

NAME = "maps.zarr"
RATES = ("rate_kg_s", "rate_low_kg_s", "rate_high_kg_s")
WIDE, DPI, MOST = 7.2, 100, 4  # inches; maps or beliefs that are shown
ARROWS, SLOWEST = 24, 1e-3  # arrows in a row; m/s, least end of the colours of speeds
TALLEST, LOWEST, TITLE = 6.0, 1.4, 0.3  # inches: a map; a figure of maps; a map's title
Part = TypeVar("Part")
Picture = tuple[str, np.ndarray, tuple[float, float, float, float]]
"""Title, values (ny, nx) or (ny, nx, 2) and rectangle (left, right, low, high) [m] of a drawn map."""


class MapAtEnd(NamedTuple):
    """Map of the first trial at the end of a run, or a layer of a map: estimate and truth (ny, nx) [ppm], of the wind
    (ny, nx, 2) [m/s]; cell [m]; group: name of the map's group in maps.zarr.
    """

    name: str
    cell: float
    estimate: np.ndarray
    truth: np.ndarray
    group: str = "0"

    @property
    def is_of_wind(self) -> bool:
        """Whether the map is of the wind."""
        return self.estimate.ndim == 3


class BeliefAtEnd(NamedTuple):
    """Belief of the first robot of a group in the first trial: density (ny, nx) [1/m²] on a rectangle (left, right,
    low, high) [m]. prior: density before the first reading; None without the key `prior`.
    """

    group: str
    density: np.ndarray
    reach: tuple[float, float, float, float]
    prior: np.ndarray | None = None


def maps_of(folder: Path) -> list[MapAtEnd]:
    """Return the gas maps of a run's first trial from the run folder, of a map with layers some of them; [] if
    there are none. Raises RunFolderError.
    """
    return [each for layers in _read(folder, "maps", _map) for each in layers]


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


def _map(group: Any) -> list[MapAtEnd]:
    kind, x = str(group.attributes["kind"]).replace("_", " "), group["x"][:]
    estimate, truth = np.asarray(group["estimate"][0], float), np.asarray(group["truth"][0], float)
    heights = group["z"][:] if "z" in group.names else []
    if estimate.ndim != 2 + ("component" in group.names or len(heights) > 0) or estimate.shape != truth.shape:
        raise ValueError(f"map {group.name} has an estimate of {estimate.shape}")
    made_by = json.loads(group.attributes["groups"])  # the first trial belongs to the first rival
    whose = f" of {made_by[0]['names'][0]}" if len(made_by) > 1 else ""
    name, cell = f"{kind} map{whose}", 2.0 * float(x[0])
    if len(heights) == 0:
        return [MapAtEnd(name, cell, estimate, truth, group.name)]
    return [
        MapAtEnd(f"{name}, z = {heights[k]:.3g} m", cell, estimate[k], truth[k], group.name)
        for k in slices(len(heights))
    ]


def _belief(group: Any) -> BeliefAtEnd:
    cell = float(group.attributes["cell_m"])
    x, y = group["x"][:], group["y"][:]
    p = np.asarray(group["probability"][0, 0], float)
    if p.shape != (len(y), len(x)):
        raise ValueError(f"{group.name} has a probability of {p.shape}")
    left, right, low, high = float(x[0]), float(x[-1]), float(y[0]), float(y[-1])
    reach = (left - cell / 2, right + cell / 2, low - cell / 2, high + cell / 2)
    prior = np.asarray(group["prior"], float) / cell**2 if "prior" in group.names else None
    return BeliefAtEnd(str(group.attributes["group"]), p / cell**2, reach, prior)


def beside_truth(run: Run, maps: Sequence[MapAtEnd]) -> bytes:
    """Return a PNG with each map's estimate on the left and the truth on the right, on one colour scale.

    maps: either of the gas or of the wind.
    """
    pictures: list[Picture] = []
    quantity = "wind" if maps[0].is_of_wind else "gas"
    for gas_map in maps:
        for name, values in (
            ("estimate", gas_map.estimate),
            (f"truth: mean of the {quantity}", gas_map.truth),
        ):
            rows, columns = values.shape[:2]
            reach = (0.0, gas_map.cell * columns, 0.0, gas_map.cell * rows)
            title = f"{gas_map.name}: {name}" if name == "estimate" else name
            pictures.append((title, values, reach))
    if quantity == "wind":
        speeds = [np.linalg.norm(values, axis=-1) for _, values, _ in pictures]
        top = max(np.nanmax(speed, initial=SLOWEST) for speed in speeds)
        return _drawn(run, pictures, (0.0, rounded_up(float(top))), "m/s")
    return _drawn(run, pictures, run.scenario.recording.range_ppm, "ppm")


def beside_sources(run: Run, beliefs: Sequence[BeliefAtEnd]) -> bytes:
    """Return a PNG with each belief map of the source position, and the true sources, two maps in a row.

    A prior that a scenario gives stands before the belief at the end.
    """
    pictures: list[Picture] = []
    for belief in beliefs:
        if belief.prior is not None:
            pictures.append((f"{belief.group}: prior", belief.prior, belief.reach))
        name = belief.group if belief.prior is None else f"{belief.group}: posterior"
        pictures.append((name, belief.density, belief.reach))
    return _drawn(run, pictures, (DENSITIES.low, DENSITIES.high), "1/m²")


def _drawn(run: Run, pictures: Sequence[Picture], scale: tuple[float, float], unit: str) -> bytes:
    """Return a PNG of maps of the floor with the sources, two in a row, in logarithmic colours; maps of the wind
    (ny, nx, 2) have arrows on linear colours of the speed.
    """
    width, length = run.scenario.domain.extent[:2]
    columns = min(2, len(pictures))
    rows = -(-len(pictures) // columns)
    inches = min(0.86 * WIDE / columns / width, TALLEST / length)  # per metre
    with theme.styled({"text.parse_math": False}):
        figure = theme.figure(WIDE, max(rows * (length * inches + TITLE), LOWEST), DPI)
        figure.set_layout_engine("constrained")
        axes = list(figure.subplots(rows, columns, squeeze=False).ravel())
        image: Any = None
        for panel in axes:
            panel.set_axis_off()
        for panel, (title, values, reach) in zip(axes, pictures, strict=False):
            panel.add_patch(Rectangle((0, 0), width, length, facecolor="#d5dbe1", zorder=0))
            is_wind = values.ndim == 3
            places = np.linalg.norm(values, axis=-1) / scale[1] if is_wind else logarithmic(values, *scale)
            image = panel.imshow(places, cmap=theme.GAS, vmin=0, vmax=1, origin="lower", extent=reach)
            if is_wind:
                _arrows(panel, values, reach, scale[1])
            edge = {"fill": False, "edgecolor": theme.INK, "linewidth": 1, "clip_on": False}
            panel.add_patch(Rectangle((0, 0), width, length, **edge))
            end = run.begin + run.result.get("simulated_s", run.scenario.duration - run.begin)
            for place in run.scenario.sources_at(end):
                star = {"color": theme.SOURCE, "markeredgecolor": "white", "markersize": 11}
                panel.plot(*place[:2], "*", **star)
            panel.set(xlim=(0, width), ylim=(0, length))
            panel.set_title(title, fontsize=9)
        theme.scale(axes, image, *scale, unit != "m/s", unit)
        return theme.png(figure)


def _arrows(panel: Any, wind: np.ndarray, reach: tuple[float, float, float, float], top: float) -> None:
    """Draw a wind (ny, nx, 2) [m/s] as at most ARROWS arrows in a row, each centred on its cell."""
    ny, nx = wind.shape[:2]
    every = -(-max(nx, ny) // ARROWS)
    shown = wind[every // 2 :: every, every // 2 :: every]
    cell = (reach[1] - reach[0]) / nx
    x, y = ((np.arange(n)[every // 2 :: every] + 0.5) * cell for n in (nx, ny))
    known = np.isfinite(shown[..., 0])
    places = [values[known] for values in np.meshgrid(x, y)]
    style = {"angles": "xy", "scale_units": "xy", "pivot": "middle", "width": 0.005}
    style |= {"color": theme.INK, "edgecolor": "white", "linewidth": 0.5}
    panel.quiver(*places, *shown[known].T, scale=top / (1.4 * every * cell), **style)


def belief_rows(groups: Sequence[dict[str, Any]]) -> list[tuple[str, ...]]:
    """Return a table row for each group of a result: name, and scores of the group's belief maps at the end."""

    def text(value: float | None) -> str:
        return "-" if value is None else f"{value:.3g}"

    return [(str(group["group"]), *(text(group[key]) for key in OF_BELIEFS)) for group in groups]


def source_rows(groups: Sequence[dict[str, Any]]) -> list[tuple[str, ...]]:
    """Return a table row for each source that the first robots of a result estimated: place, rate and its interval."""
    rows = []
    for group in groups:
        for robot, sources in enumerate(group.get("sources", [])[:MOST]):
            for source in sources:
                rate, low, high = (f"{1e6 * source[key]:.3g}" for key in RATES)
                place = f"{source['x']:.2f}, {source['y']:.2f}"
                chance = f"{100 * source['probability']:.0f} %"
                row = str(robot), place, f"{source['spread_m']:.2f}", rate, f"{low} to {high}", chance
                rows.append((str(group["group"]), *row))
    return rows
