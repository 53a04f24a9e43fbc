"""Drawing of recorded gas over the scene, with wind and robots, at any moment of a run: for pictures, films, reports.

Only the artists of moving parts are updated for a new time, so a film draws walls, scales and text once.
"""

from collections.abc import Sequence
from math import degrees
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from matplotlib import rcParams
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.legend import Legend
from matplotlib.lines import Line2D
from matplotlib.text import Text
from matplotlib.transforms import Affine2D

from taichi_plume.grid.shapes import Shape, rotation
from taichi_plume.observed.scales import Scale
from taichi_plume.record.drawing import pointed_disc
from taichi_plume.report import scene, theme
from taichi_plume.results.run import Run
from taichi_plume.results.tracks import Track
from taichi_plume.scenario.scenario import Scenario

if TYPE_CHECKING:
    from xarray import DataArray, Dataset

RIM = 5.0  # points, of the outline of a robot that has found the source; half of it lies outside the body
BODY = 0.011  # robots are drawn at least this large, over the longer side of the view
ROUND = 20  # corners of a body
MOST_NAMES = 6  # robots that the legend names individually
LETTER, LOWEST = 0.075, 1.0  # inches: a letter's width; the height of a picture's scale
BESIDE, BELOW, ON_TOP = 0.6, 0.5, 0.68  # inches around the axes, for letters of 9 points
BAR = 1.15
FAST, SLOWEST = 1.2, 1e-3  # length of fast arrows over their distance; least speed of these [m/s]
CROWDED = 1.6  # width of a legend over that of the figure, from which it has two rows


class Arrows(NamedTuple):
    """Wind as drawn: times (n,) [s]; for each time the arrows' tails and vectors in the picture, (m, 2) [m]."""

    times: np.ndarray
    tails: list[np.ndarray]
    ways: list[np.ndarray]

    @classmethod
    def of(cls, wind: "Dataset | None") -> "Arrows | None":
        """Return the wind on a plane as arrows; the 95 % quantile of the speed is drawn FAST times their distance long.

        wind: variables u, v or w along the plane's axes, over time or at one time.
        """
        if wind is None or not wind.data_vars:
            return None
        if "time" not in wind.dims:
            wind = wind.expand_dims("time")
        some = next(iter(wind.data_vars.values()))
        along = [wind[f"{'uvw'['xyz'.index(axis)]}_{some.view}"] for axis in some.axes]
        vertical, horizontal = (some[dim].values for dim in some.dims[1:])
        middle = np.stack(np.meshgrid(horizontal, vertical), axis=-1).reshape(-1, 2)
        velocity = np.stack([part.values.reshape(len(wind.time), -1) for part in along], axis=-1).astype(
            float
        )
        known = np.linalg.norm(velocity, axis=-1)
        top = max(float(np.nanquantile(known, 0.95)), SLOWEST) if known.size else SLOWEST
        ways = list(np.nan_to_num(velocity) * (FAST * float(np.mean(some.cell)) / top))
        return cls(wind.time.values, [middle - way / 2 for way in ways], ways)


def edges(picture: "DataArray") -> tuple[float, float, float, float]:
    """Return the left, right, bottom and top edge of a picture in the plane's axes [m]."""
    (dx, dy), (y, x) = picture.cell, (picture[dim].values for dim in picture.dims[-2:])
    return float(x[0] - dx / 2), float(x[-1] + dx / 2), float(y[0] - dy / 2), float(y[-1] + dy / 2)


class Present(NamedTuple):
    """Scene of a running simulation: its scenario, and the shapes of the obstacles."""

    scenario: Scenario
    shapes: Sequence[Shape]


Scene = Run | Present


class PlumeView:
    """Matplotlib view of one plane of a run: recorded gas, scene, wind and robots; `show` updates the view to a time.

    moving: artists that `show` changes.
    """

    def __init__(
        self, axes: Axes, run: Scene, picture: "DataArray", tracks: Sequence[Track] = (), wind: bool = True
    ):
        self.axes, self.run, self.picture, self.tracks = axes, run, picture, list(tracks)
        self.plane, self.scale = theme.PLANES[picture.axes], Scale.of(picture.attrs)
        extent = run.scenario.domain.extent
        self.length = max(extent[d] for d in self.plane)
        plain = {"sizes": False, "plane": self.plane, "starts": False, "sources": False}
        solids = scene.draw(axes, run.scenario, run.shapes, **plain)
        self.sources = [scene.source_mark(axes, source, self.plane) for _, source in run.scenario.sources]
        colors = theme.colors_of(picture.units)
        self.image = axes.imshow(
            np.zeros(picture.shape[-2:], np.uint8), cmap=colors, vmin=0, vmax=255, origin="lower",
            extent=edges(picture), interpolation="bilinear", zorder=1,
        )  # fmt: skip
        axes.set_xlim(*_around(extent[self.plane[0]], self.length))
        axes.set_ylim(*_around(extent[self.plane[1]], self.length))
        if self.plane != theme.ABOVE:  # obstacles may stand before or behind the plane
            for solid in solids:
                solid.set_alpha(0.55)
        shapes = zip(solids, run.shapes, strict=True)
        self.walkers = [(patch, shape.model) for patch, shape in shapes if shape.model and shape.model.motion]
        arrows = PolyCollection([], facecolor=theme.WIND, edgecolor="none", alpha=0.42, zorder=3)
        self.arrows = axes.add_collection(arrows)
        self.arrows.set_visible(wind)
        colors = [theme.robot(track.number) for track in self.tracks]
        self.trails = axes.add_collection(LineCollection([], colors=colors, linewidths=1.3, zorder=8))
        bodies = PolyCollection([], facecolors=colors, edgecolors="white", linewidths=0.8, zorder=11)
        self.bodies = axes.add_collection(bodies)
        # beneath the bodies, so that a wide rim covers no small body
        rims = PolyCollection([], facecolors="none", edgecolors=theme.FOUND, linewidths=RIM, zorder=10)
        self.rims = axes.add_collection(rims)
        self.crosses: list[Line2D] = []
        if self.plane == theme.ABOVE:
            declaring = [track for track in self.tracks if has_declared(track)]
            self.crosses = [declared_mark(axes, theme.robot(track.number)) for track in declaring]
        self.clock: Text | None = None  # set by `figure_of`
        patches = [patch for patch, _ in self.walkers]
        drawn = [self.image, *patches, self.arrows, self.trails, self.rims, self.bodies]
        if run.scenario.sources_change:
            drawn += [mark for marks in self.sources for mark in marks]
        self.moving: list[Artist] = [*drawn, *self.crosses]

    def show(self, t: float, values: np.ndarray, arrows: Arrows | None = None) -> None:
        """Update the view to time t [s]: values of the picture (rows, columns), wind arrows, obstacles, robots."""
        self.image.set_data(self.scale.bytes(values))
        for patch, model in self.walkers:
            place = (*model.motion.place(model.center, t), 0.0)
            way = [place[d] - (*model.center[:2], 0.0)[d] for d in self.plane]
            patch.set_transform(Affine2D().translate(*way) + self.axes.transData)
        if self.run.scenario.sources_change:
            places = self.run.scenario.sources_at(t)[:, list(self.plane)]
            for (disc, star), place in zip(self.sources, places, strict=True):
                is_there = bool(np.isfinite(place).all())
                disc.set_visible(is_there)
                disc.set_center(tuple(place))
                star.set_data(place[:1], place[1:])
        if arrows is not None and len(arrows.times):
            n = max(0, int(np.searchsorted(arrows.times, t + 1e-6, side="right")) - 1)
            self.arrows.set_verts(arrow_outlines(arrows.tails[n], arrows.ways[n]))
        self._robots(t)

    def _robots(self, t: float) -> None:
        shown = [(track, track.at(t)) for track in self.tracks]
        outlines = [self._body(track, n) if n >= 0 else np.zeros((0, 2)) for track, n in shown]
        found = [n >= 0 and bool(track.values["found"][n]) for track, n in shown]
        self.bodies.set_verts(outlines)
        self.rims.set_verts([line for line, has_found in zip(outlines, found, strict=True) if has_found])
        declared = [pair for pair in shown if has_declared(pair[0])]
        for mark, (track, n) in zip(self.crosses, declared, strict=False):
            put_mark(mark, track.declared(n))
        a, b = ("xyz"[d] for d in self.plane)
        trailing = [
            (track.values, n) for track, n in shown if self.plane == theme.ABOVE or track.group.body.flies
        ]
        self.trails.set_segments(
            [np.column_stack([values[a][: n + 1], values[b][: n + 1]]) for values, n in trailing]
        )

    def _body(self, track: Track, n: int) -> np.ndarray:
        """Return the outline (corners, 2) [m] of a robot at row n of its track: a pointed disc, from the side a box."""
        x, y, z, heading = (float(track.values[name][n]) for name in ("x", "y", "z", "heading"))
        place = (x, y)
        radius = max(track.group.body.radius, BODY * self.length)
        if self.plane != theme.ABOVE:
            low, high = place[self.plane[0]] - radius, place[self.plane[0]] + radius
            top = z + max(track.group.body.height, radius)
            return np.array([[low, z], [high, z], [high, top], [low, top]])
        return np.array(place) + pointed_disc(radius, 1.8, ROUND) @ rotation(degrees(heading)).T


def has_declared(track: Track) -> bool:
    """Return whether the robot of a track has declared a source position at any time of the run."""
    return bool(track.values["declarations"].any())


def declared_mark(axes: Axes, color: str) -> Line2D:
    """Return a new cross, still without a position, for the source position that a robot of this colour declares."""
    how: dict[str, Any] = {"linestyle": "none", "marker": "X", "markersize": 11, "markeredgewidth": 1.6}
    return axes.plot([], [], color=color, zorder=12, **how)[0]


def put_mark(mark: Line2D, declared: tuple[np.ndarray, bool] | None) -> None:
    """Move a cross to a declared source position, its rim green if it is right, else orange; None: hide."""
    place, right = declared or (np.zeros((0, 2)), False)
    mark.set_data(*np.atleast_2d(place).T)
    mark.set_markeredgecolor(theme.FOUND if right else theme.WRONG)


def arrow_outlines(tails: np.ndarray, ways: np.ndarray) -> np.ndarray:
    """Return outlines (n, 7, 2) of slim arrows; tails: start points, ways: vectors from tail to tip, (n, 2) [m]."""
    along, across = ways[:, None], np.stack([-ways[:, 1], ways[:, 0]], axis=-1)[:, None]
    shape = np.array(
        [[0, 0.028], [0.62, 0.028], [0.62, 0.15], [1, 0], [0.62, -0.15], [0.62, -0.028], [0, -0.028]]
    )
    return tails[:, None] + shape[None, :, :1] * along + shape[None, :, 1:] * across


def figure_of(
    run: Scene,
    picture: "DataArray",
    tracks: Sequence[Track],
    width: float,
    dpi: float,
    letters: float = 1.0,
    wind: bool = True,
    height: float | None = None,
) -> tuple[Figure, PlumeView]:
    """Return a figure `width` inches wide with a picture, colour bar and legend, and its view; letters: text size/9.

    height [inches]: by default that of the picture. Raises InputError if the figure would be too small.
    """
    extent = run.scenario.domain.extent
    sides = [extent[d] for d in theme.PLANES[picture.axes]]
    left, right, below, above = (letters * part for part in (BESIDE, BAR, BELOW, ON_TOP))
    ways = [high - low for low, high in (_around(side, max(sides)) for side in sides)]
    broad = width - left - right
    if height is not None:
        theme.require_size((width, height), (left + right, below + above))
    room = 1.05 * width if height is None else height - below - above
    tall = min(broad * ways[1] / ways[0], room)
    high_up = max(tall, letters * LOWEST)  # a narrow plane has the height of its colour bar
    if height is None:
        height = _even(high_up + below + above, dpi)
    else:
        broad, spare = tall * ways[0] / ways[1], broad - tall * ways[0] / ways[1]
        left += spare / 2
    below = max(below, height - above - high_up)
    figure = theme.figure(width, height, dpi)
    under = below + (high_up - tall) / 2
    axes = figure.add_axes((left / width, under / height, broad / width, tall / height))
    view = PlumeView(axes, run, picture, tracks, wind)
    beside = figure.add_axes(
        ((left + broad + 0.1 * letters) / width, below / height, 0.14 * letters / width, high_up / height)
    )
    _bar(axes, view, int((high_up + below) / (LETTER * letters)), cax=beside)
    _legend(figure, run, view, letters * BESIDE / width, 1 - 0.12 * letters / height)
    top = (under + tall + 0.04 * letters) / height
    view.clock = figure.text(left / width, top, "", va="bottom", fontweight="bold")
    view.moving.append(view.clock)
    return figure, view


def view_in(axes: Axes, run: Scene, picture: "DataArray", tracks: Sequence[Track], wind: bool) -> PlumeView:
    """Return a view that draws into axes of the user, with a colour bar beside; `axes.legend()` adds the legend."""
    view = PlumeView(axes, run, picture, tracks, wind)
    _bar(axes, view, theme.LONGEST_NAME)
    view.clock = axes.set_title("", loc="left")
    for handle in _handles(run, view):
        axes.add_line(handle)
    return view


def _bar(axes: Axes, view: PlumeView, letters: int, **where: Any) -> None:
    """Add the colour bar of a view; letters: that its label can have."""
    picture = view.picture
    plane, scale = f"\n{picture.plane}" if picture.plane else "", view.scale
    name = theme.short(picture.quantity, max(8, letters - len(f" [{picture.units}]")))
    title = f"{name} [{picture.units}]{plane}"
    theme.scale(axes, view.image, scale.low, scale.high, scale.kind == "log", title, **where)


def _handles(run: Scene, view: PlumeView) -> list[Line2D]:
    """Return a legend's entries: source, heater, robots, those that have found the source or declared one, wind."""

    def mark(label: str, **how: Any) -> Line2D:
        return Line2D([], [], linestyle=how.pop("linestyle", "none"), label=label, **how)

    handles = []
    if run.scenario.sources:
        handles.append(mark("source", marker="*", color=theme.SOURCE, markeredgecolor="white", markersize=12))
    if run.scenario.heat and run.scenario.heat.heaters:
        handles.append(mark("heater", marker="o", color=theme.WARM, alpha=0.6, markersize=9))
    for track in view.tracks if len(view.tracks) <= MOST_NAMES else view.tracks[:1]:
        name = theme.short(track.name) if len(view.tracks) <= MOST_NAMES else "robots and their trails"
        style = {"color": theme.robot(track.number), "linestyle": "-", "markeredgecolor": "white"}
        handles.append(mark(name, marker="o", markersize=7, **style))
    if any(track.found_at is not None for track in view.tracks):
        style = {"color": "white", "markeredgecolor": theme.FOUND, "markeredgewidth": 2}
        handles.append(mark("has found the source", marker="o", markersize=7, **style))
    last = [track.declared(len(track.t) - 1) for track in view.tracks] if view.crosses else []
    for right, label, rim in ((True, "declared rightly", theme.FOUND), (False, "falsely", theme.WRONG)):
        if any(word is not None and word[1] == right for word in last):
            style = {"color": "white", "markeredgecolor": rim, "markeredgewidth": 1.6}
            handles.append(mark(label, marker="X", markersize=9, **style))
    if view.arrows.get_visible():
        handles.append(mark("wind", marker=r"$\rightarrow$", color=theme.WIND, alpha=0.7, markersize=11))
    return handles


def _legend(figure: Figure, run: Scene, view: PlumeView, x: float, y: float) -> None:
    """Add a legend of all markers in one row, its upper left corner at the fractions x, y of the figure."""
    handles = _handles(run, view)

    def made(size: float, rows: int) -> Legend:
        legend = figure.legend(
            handles=handles, loc="upper left", bbox_to_anchor=(x, y), ncols=-(-len(handles) // rows), borderaxespad=0,
            columnspacing=1.0, handletextpad=0.3, handlelength=1.3, fontsize=size, markerscale=size / usual,
        )  # fmt: skip
        theme.verbatim(legend.get_texts())
        return legend

    usual = FontProperties(size=rcParams["legend.fontsize"]).get_size_in_points()
    size, rows = usual, 1
    for _ in range(2):  # many robots: smaller letters; a narrow figure: also two rows
        legend = made(size, rows)
        share = legend.get_window_extent().width / (figure.bbox.width * (1 - x))
        if not handles or share <= 1:
            return
        legend.remove()
        if share > CROWDED and rows == 1:
            rows = 2
        else:
            size /= 1.03 * share
    made(size, rows)


def _around(length: float, longest: float) -> tuple[float, float]:
    """Return the limits [m] of an axis along which the room has `length` [m]; margin: 2.5 % of `longest` [m]."""
    return -0.025 * longest, length + 0.025 * longest


def _even(inches: float, dpi: float) -> float:
    """Return a length [inches] rounded to an even number of pixels, as video encoders need."""
    return 2 * round(inches * dpi / 2) / dpi
