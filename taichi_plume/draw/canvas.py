"""Views of the drawing as Bokeh figures: from above and, in 3-D, from the side. They show objects and know no text."""

from collections.abc import Collection, Mapping, Sequence
from math import pi
from typing import Any

import numpy as np
from bokeh.core.property.descriptors import UnsetValueError
from bokeh.core.property.vectorization import value
from bokeh.models import ColumnDataSource, Label, Range1d, WheelZoomTool
from bokeh.plotting import figure

from taichi_plume.draw.bodies import Body
from taichi_plume.draw.objects import Scene, Thing
from taichi_plume.draw.parts import Plane, Point, Rectangle
from taichi_plume.execution.latest_instant import Instant, Picture
from taichi_plume.report import theme
from taichi_plume.report.theme import ABOVE

MARGIN = 0.08  # of the longer side, around the room
NEAR = 10.0  # pixels from a handle within which the pointer takes the handle
USUAL_SIZE = (600.0, 450.0)  # pixels
LABELS = 2.0  # pixels by which the figure's inner part may change without being fitted again
ARROW = 0.05  # of the longer side: an arrow of the fastest wind
FINE = 200  # pixels along the longer side of a picture, at least half of them
FONT = "Helvetica, Arial, sans-serif"
CHOSEN, WRONG, UNLIKELY = "#0b6bcb", theme.ERROR, theme.UNLIKELY
AT_START = 0.15  # opacity of a walker's start while the walker of a run is drawn
SHAPES = ("xs", "ys", "color", "alpha", "edge", "width", "path")


class Canvas:
    """A figure of one plane. `show` draws objects, `show_run` the state of a run below them."""

    def __init__(self, plane: Plane):
        self.plane = plane
        self.figure = figure(
            x_range=Range1d(start=-0.3, end=4.3), y_range=Range1d(start=-0.3, end=3.3), tools="", toolbar_location=None,
            sizing_mode="stretch_both", min_border_left=60, min_border_bottom=50, min_border_top=10,
            min_border_right=10, output_backend="canvas", x_axis_label=f"{'xyz'[plane[0]]} [m]",
            y_axis_label=f"{'xyz'[plane[1]]} [m]", name="above" if plane == ABOVE else "side",
        )  # fmt: skip
        wheel = WheelZoomTool()
        self.figure.add_tools(wheel)
        self.figure.toolbar.active_scroll = wheel
        self.figure.toolbar.active_drag = None
        self.room: tuple[float, ...] | None = None
        self._fitted = USUAL_SIZE
        self.sight: Instant | None = None
        self._beside: tuple[Scene | None, Scene | None, Picture | None] = (None, None, None)
        for name in ("inner_width", "inner_height"):
            self.figure.on_change(name, lambda _attr, _old, _new: self._resized())
        self._style()
        names: dict[str, Sequence[str]] = {
            "floor": ("x", "y", "w", "h"), "image": ("image", "x", "y", "dw", "dh"),
            "wind": ("x0", "y0", "x1", "y1"), "areas": SHAPES, "lines": SHAPES, "handles": ("x", "y", "name", "marker"),
            "flows": ("x", "y", "angle", "color"), "labels": ("x", "y", "text", "color"),
            "marks": ("x", "y", "text", "color"),
            "robots": ("x", "y", "color"), "headings": ("x0", "y0", "x1", "y1", "color"), "sketch": ("x", "y"),
            "walkers": ("xs", "ys"), "earlier": ("xs", "ys"),
        }  # fmt: skip
        self.sources = {name: ColumnDataSource({key: [] for key in keys}) for name, keys in names.items()}
        self.sources["image"].name = "gas" if plane == ABOVE else None
        self._glyphs()

    def _style(self) -> None:
        plot: Any = self.figure
        plot.background_fill_color, plot.border_fill_color = "#eceff2", "#ffffff"
        plot.grid.grid_line_color, plot.grid.grid_line_alpha = "#c9d1d9", 0.6
        plot.grid.level = "underlay"
        plot.outline_line_color = None
        for axis in plot.axis:
            axis.axis_label_text_font = axis.major_label_text_font = FONT
            axis.axis_label_text_font_style = "normal"
            axis.axis_label_text_color = axis.major_label_text_color = theme.FAINT
            axis.axis_line_color = axis.minor_tick_line_color = None
            axis.major_tick_line_color = "#c9d1d9"

    def _glyphs(self) -> None:
        plot, of = self.figure, self.sources
        plot.rect(
            "x", "y", "w", "h", source=of["floor"], fill_color="#ffffff", line_color=None, level="image"
        )
        plot.image_rgba("image", "x", "y", "dw", "dh", source=of["image"], level="image")
        plot.segment("x0", "y0", "x1", "y1", source=of["wind"], line_color=theme.WIND, line_alpha=0.45)
        plot.patches(
            "xs",
            "ys",
            source=of["areas"],
            fill_color="color",
            fill_alpha="alpha",
            line_color="edge",
            line_width="width",
        )
        plot.patches(
            "xs",
            "ys",
            source=of["walkers"],
            fill_color=theme.SOLID,
            fill_alpha=0.95,
            line_color=theme.SOLID_EDGE,
        )
        plot.multi_line(
            "xs", "ys", source=of["earlier"], line_color="#000000", line_width=2, line_dash="dashed"
        )
        plot.multi_line(
            "xs", "ys", source=of["lines"], line_color="edge", line_width="width", line_alpha="alpha"
        )
        plot.scatter(
            "x",
            "y",
            angle="angle",
            source=of["flows"],
            marker="triangle",
            size=11,
            fill_color="color",
            line_color=None,
        )
        plot.segment("x0", "y0", "x1", "y1", source=of["headings"], line_color="color", line_width=3)
        plot.scatter(
            "x", "y", source=of["robots"], size=13, fill_color="color", line_color="#ffffff", line_width=1.5
        )
        plot.line("x", "y", source=of["sketch"], line_color=CHOSEN, line_dash="dashed", line_width=2)
        plot.text(
            "x", "y", "text", source=of["labels"], text_color="color", text_font=value(FONT), text_font_size="11px",
            text_align="center", text_baseline="top", y_offset=3,
        )  # fmt: skip
        plot.scatter(
            "x", "y", marker="marker", source=of["handles"], size=9, fill_color="#ffffff", line_color=CHOSEN,
            line_width=2,
        )  # fmt: skip
        plot.scatter("x", "y", source=of["marks"], size=18, fill_color="color", line_color="#ffffff")
        plot.text(
            "x", "y", "text", source=of["marks"], text_color="#ffffff", text_font=value(FONT), text_font_size="11px",
            text_align="center", text_baseline="middle", text_font_style="bold",
        )  # fmt: skip

        self.note = Label(
            x=6, y=6, x_units="screen", y_units="screen", text="", text_color=UNLIKELY, text_font=FONT,
            text_font_size="12px", background_fill_color="#ffffff", background_fill_alpha=0.9,
        )  # fmt: skip
        plot.add_layout(self.note)

    # ---------------------------------------------------------------- objects

    def show(
        self,
        of: Scene,
        chosen: str = "",
        wrong: Collection[str] = (),
        marks: Sequence[tuple[str, Point, bool]] = (),
    ) -> None:
        """Draw the objects of a text. chosen, wrong: paths of objects; marks: (number, position, is error)."""
        if self.plane not in of.planes:
            return
        if of.room != self.room:
            self.room = of.room
            self.fit()
        width, height = (of.room[d] for d in self.plane) if of.room else (0.0, 0.0)
        self.sources["floor"].data = {"x": [width / 2], "y": [height / 2], "w": [width], "h": [height]}
        areas: dict[str, list[Any]] = {key: [] for key in SHAPES}
        lines: dict[str, list[Any]] = {key: [] for key in SHAPES}
        labels: dict[str, list[Any]] = {key: [] for key in ("x", "y", "text", "color")}
        for thing in of.things:
            for outline in thing.outlines(self.plane):
                into = areas if outline.closed and thing.path != "domain" else lines
                points = outline.points
                if outline.closed and into is lines:
                    points = np.concatenate([points, points[:1]])
                for key, part in self._look(thing, outline.closed, chosen, wrong).items():
                    into[key].append(part)
                into["xs"].append(points[:, 0].copy())
                into["ys"].append(points[:, 1].copy())
            for key, part in self._label(thing).items():
                labels[key].append(part)
        self.sources["flows"].data = self._flows(of)
        self.sources["areas"].data, self.sources["lines"].data = areas, lines
        self.sources["labels"].data = labels
        self.sources["marks"].data = {
            "x": [place[0] for _, place, _ in marks],
            "y": [place[1] for _, place, _ in marks],
            "text": [text for text, _, _ in marks],
            "color": [WRONG if is_error else UNLIKELY for _, _, is_error in marks],
        }
        self.show_handles(of.thing(chosen))

    def _look(self, thing: Thing, closed: bool, chosen: str, wrong: Collection[str]) -> dict[str, Any]:
        kind = thing.path.partition("[")[0]
        alpha = {"robots": 0.35, "obstacles": 0.95, "arena": 0.0, "gas": 0.6}.get(
            kind.partition(".")[0], 0.35
        )
        edge = {"obstacles": theme.SOLID_EDGE, "domain": theme.INK}.get(kind, thing.color)
        width = 1.0 if closed else 1.5
        if thing.path.startswith("wind.openings") and not closed:
            width = 7.0
        if thing.path == "domain":
            width = 2.0
        if thing.path in wrong:
            edge, width = WRONG, max(width, 2.5)
        if thing.path == chosen:
            edge, width = CHOSEN, max(width, 2.5)
        if thing.path.startswith("robots") and isinstance(thing.part, Rectangle):
            alpha = 0.2  # an area of starts
        if self.sight is not None and isinstance(thing.part, Body) and thing.part.walks:
            alpha = AT_START
        return {
            "color": thing.color, "alpha": alpha if closed else 1.0, "edge": edge, "width": width, "path": thing.path,
        }  # fmt: skip

    def _label(self, thing: Thing) -> dict[str, Any]:
        if self.plane != ABOVE or thing.path in ("domain", "arena") or thing.part is None:
            return {}
        outlines = thing.outlines(self.plane)
        if not outlines:
            return {}
        points = np.concatenate(
            [outline.points for outline in outlines if outline.closed] or [outlines[0].points]
        )
        x, y = (
            float(np.nanmean([np.nanmin(points[:, 0]), np.nanmax(points[:, 0])])),
            float(np.nanmin(points[:, 1])),
        )
        if thing.path.startswith("wind.") and self.room is not None:
            y = min(max(y, 0.06 * self.room[1]), 0.97 * self.room[1])
            x = min(max(x, 0.08 * self.room[0]), 0.92 * self.room[0])
        return {"x": x, "y": y, "text": thing.name, "color": theme.INK}

    def _flows(self, of: Scene) -> dict[str, list[Any]]:
        """Return arrowheads along the openings through which air comes in (inward) or leaves (outward)."""
        flows: dict[str, list[Any]] = {key: [] for key in ("x", "y", "angle", "color")}
        for thing in of.things:
            model: Any = thing.part.model if thing.part is not None else None
            if (
                not thing.path.startswith("wind.openings")
                or model is None
                or not model.passes
                or model.normal not in self.plane
            ):
                continue
            (a, b), room = thing.outlines(self.plane)[0].points, self.room or ()
            inward = -model.direction if model.side else model.direction
            angle = (
                (0 if inward > 0 else pi)
                if self.plane[0] == model.normal
                else (pi / 2 if inward > 0 else -pi / 2)
            )
            count = max(1, min(6, round(float(np.hypot(*(b - a))) / (0.12 * max(room)))))
            for n in range(count):
                x, y = a + (n + 0.5) / count * (b - a)
                shift = 1.2 * ARROW / 4 * max(room) * inward
                x, y = (x + shift, y) if self.plane[0] == model.normal else (x, y + shift)
                for key, part in zip(flows, (x, y, angle - pi / 2, thing.color), strict=True):
                    flows[key].append(part)
        return flows

    def show_handles(self, thing: Thing | None) -> None:
        """Draw the handles of an object, or none."""
        handles = thing.handles(self.plane) if thing is not None else {}
        self.sources["handles"].data = {
            "x": [x for x, _ in handles.values()],
            "y": [y for _, y in handles.values()],
            "name": list(handles),
            "marker": ["circle" if name in ("center", "turn") else "square" for name in handles],
        }

    def sketch(self, points: Sequence[Point]) -> None:
        """Draw the line of an object that is being drawn."""
        self.sources["sketch"].data = {"x": [x for x, _ in points], "y": [y for _, y in points]}

    @property
    def pixels(self) -> tuple[float, float]:
        """Width and height of the figure's inner part [pixels]."""
        try:
            return max(50.0, self.figure.inner_width), max(50.0, self.figure.inner_height)
        except UnsetValueError:  # no browser has drawn the figure yet
            return USUAL_SIZE

    def fit(self) -> None:
        """Show the whole room, at the same scale along both axes."""
        if self.room is None:
            return
        sides, pixels = [self.room[d] for d in self.plane], self.pixels
        self._fitted = pixels
        margin = MARGIN * max(sides)
        step = max((side + 2 * margin) / count for side, count in zip(sides, pixels, strict=True))
        for range_, side, count in zip(
            (self.figure.x_range, self.figure.y_range), sides, pixels, strict=True
        ):
            range_.update(start=(side - step * count) / 2, end=(side + step * count) / 2)

    def _resized(self) -> None:
        """Show the whole room again if the figure has another size, not only other labels at its axes."""
        if max(abs(a - b) for a, b in zip(self.pixels, self._fitted, strict=True)) > LABELS:
            self.fit()

    def pixel(self) -> float:
        """Return the size of a pixel [m]."""
        return abs(self.figure.x_range.end - self.figure.x_range.start) / self.pixels[0]

    def pan(self, dx: float, dy: float) -> None:
        """Move the view by pixels."""
        step = self.pixel()
        x, y = self.figure.x_range, self.figure.y_range
        x.update(start=x.start - dx * step, end=x.end - dx * step)
        y.update(start=y.start + dy * step, end=y.end + dy * step)

    # ---------------------------------------------------------------- a run

    def show_run(
        self,
        sight: Instant | None,
        of: Scene | None = None,
        present: Scene | None = None,
        name: str = "run",
        picture: Picture | None = None,
    ) -> None:
        """Draw the state of a run, and the room of the run where the present room differs. None: remove them.

        of: objects of the run's text, present: of the drawn text; picture: that is shown. Picture, wind and robots are
        seen from above alone. A walker's start is drawn otherwise by `show` while a run is seen.
        """
        beside = (of, present, picture)
        if sight is self.sight and all(a is b for a, b in zip(beside, self._beside, strict=True)):
            return
        self.sight, self._beside = sight, beside
        seen = sight is not None and of is not None and of.room is not None and self.plane in of.planes
        if not seen or sight is None or of is None or of.room is None:
            for part in ("image", "wind", "headings", "robots", "walkers", "earlier"):
                source = self.sources[part]
                source.data = {key: [] for key in source.data}
            self.note.text = ""
            return
        bodies = [thing.part for thing in of.things if isinstance(thing.part, Body)]
        walkers = [body.outline_at(sight.t, self.plane).points for body in bodies if body.walks]
        self.sources["walkers"].data = _columns(walkers)
        self._show_room(of, present if present is not None else of, name)
        if self.plane == ABOVE:
            self._show_air(sight, picture, of.room)

    def _show_room(self, of: Scene, present: Scene, name: str) -> None:
        """Draw what differs between the room of a run and the present one, and say whose gas is seen."""
        lines = []
        for thing in of.drawn_otherwise(present):
            for points, closed in thing.outlines(self.plane):
                lines.append(np.concatenate([points, points[:1]]) if closed else points)
        self.sources["earlier"].data = _columns(lines)
        self.note.text = ""
        if of.data != present.data:
            dashed = "; dashed: its room" if lines else ""
            self.note.text = f"Gas, wind and robots: {name}, started before your last changes{dashed}"

    def _show_air(self, sight: Instant, picture: Picture | None, room: tuple[float, ...]) -> None:
        image: dict[str, list[Any]] = {key: [] for key in ("image", "x", "y", "dw", "dh")}
        if picture is not None:
            height, width = (n * picture.cell for n in picture.values.shape)
            image = {"image": [_colors(picture)], "x": [0.0], "y": [0.0], "dw": [width], "dh": [height]}
        self.sources["image"].data = image
        x, y, u, v = sight.wind
        fastest = max(float(np.hypot(u, v).max(initial=0.0)), 1e-9)
        scale = ARROW * max(room[:2]) / fastest
        ends = {
            "x0": x - scale * u / 2,
            "y0": y - scale * v / 2,
            "x1": x + scale * u / 2,
            "y1": y + scale * v / 2,
        }
        self.sources["wind"].data = ends
        x, y, heading = sight.robots
        colors = [theme.robot(n) for n in range(len(x))]
        reach = 0.03 * max(room[:2])
        ends: Mapping[str, Any] = {"x1": x + reach * np.cos(heading), "y1": y + reach * np.sin(heading)}
        self.sources["headings"].data = {"x0": x, "y0": y, "color": colors, **ends}
        self.sources["robots"].data = {"x": x, "y": y, "color": colors}

    # ---------------------------------------------------------------- pointing

    def handle_at(self, thing: Thing | None, at: Point) -> str | None:
        """Return the handle of an object near a point, the nearest first; None if there is none near."""
        handles = thing.handles(self.plane) if thing is not None else {}
        apart = {name: np.hypot(x - at[0], y - at[1]) for name, (x, y) in handles.items()}
        nearest = min(apart, key=apart.__getitem__, default=None)
        return nearest if nearest is not None and apart[nearest] <= NEAR * self.pixel() else None

    def apart(self, a: Point, b: Point) -> bool:
        """Return whether two points are so far from each other that a pointer can tell them apart."""
        return float(np.hypot(a[0] - b[0], a[1] - b[1])) > NEAR * self.pixel()

    def thing_at(self, of: Scene, at: Point) -> str | None:
        """Return the path of the topmost object at a point; None if there is none but the room."""
        near = NEAR * self.pixel()
        for thing in reversed(of.things):
            if thing.path == "domain" or thing.part is None:
                continue
            for outline in thing.outlines(self.plane):
                if outline.closed and thing.path != "arena" and _inside(outline.points, at):
                    return thing.path
                if _distance(outline.points, at, outline.closed) <= near:
                    return thing.path
        return None


def _colors(picture: Picture) -> np.ndarray:
    """Return a picture as an image RGBA (uint32), linear between the middles of pixels.

    Solids, and on a logarithmic scale the lowest values, are transparent.
    """
    from scipy.ndimage import zoom

    def finer(values: np.ndarray) -> np.ndarray:
        return np.asarray(zoom(values.astype(np.float32), times, order=1, mode="nearest", grid_mode=True))

    times, air = max(1, FINE // max(picture.values.shape)), np.isfinite(picture.values)
    shade = np.rint(finer(picture.scale.bytes(picture.values) * air) / np.maximum(finer(air), 1e-6))
    pixels = theme.colors_of(picture.unit)(shade.astype(np.uint8), bytes=True)
    pixels[~np.kron(air, np.ones((times, times), bool)) | (picture.scale.kind == "log") & (shade == 0)] = 0
    return np.ascontiguousarray(pixels).view(np.uint32)[..., 0]


def _columns(outlines: Sequence[np.ndarray]) -> dict[str, Any]:
    return {
        "xs": [points[:, 0].copy() for points in outlines],
        "ys": [points[:, 1].copy() for points in outlines],
    }


def _inside(points: np.ndarray, at: Point) -> bool:
    """Return whether a point lies in polygons separated by rows of NaN, by the even-odd rule, as Bokeh fills them."""
    crossings = 0
    for a, b in _edges(points, True):
        if (a[1] > at[1]) != (b[1] > at[1]):
            crossings += at[0] < a[0] + (at[1] - a[1]) / (b[1] - a[1]) * (b[0] - a[0])
    return bool(crossings % 2)


def _edges(points: np.ndarray, closed: bool) -> list[tuple[np.ndarray, np.ndarray]]:
    gaps = np.flatnonzero(np.isnan(points[:, 0]))
    edges = []
    for part in np.split(points, gaps):
        part = part[~np.isnan(part[:, 0])]
        ends = np.roll(part, -1, axis=0) if closed else part[1:]
        edges += list(zip(part, ends, strict=False))
    return edges


def _distance(points: np.ndarray, at: Point, closed: bool) -> float:
    """Return the distance of a point from the edges of an outline."""
    least = np.inf
    for a, b in _edges(points, closed):
        along = b - a
        part = float(np.clip(np.dot(at - a, along) / max(float(np.dot(along, along)), 1e-18), 0.0, 1.0))
        least = min(least, float(np.hypot(*(a + part * along - at))))
    return least
