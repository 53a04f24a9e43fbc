"""Views of the drawing as Bokeh figures: from above and, in 3-D, from the sides. They show objects and know no text."""

from collections.abc import Collection, Iterable, Iterator, Sequence
from math import pi
from typing import Any

import numpy as np
from bokeh.core.property.descriptors import UnsetValueError
from bokeh.core.property.vectorization import value
from bokeh.events import MouseWheel
from bokeh.models import (
    ColorBar,
    ColumnDataSource,
    HoverTool,
    Label,
    LinearColorMapper,
    LogColorMapper,
    Range1d,
    WheelZoomTool,
)
from bokeh.plotting import figure

from taichi_plume.draw.objects import Scene, Thing
from taichi_plume.draw.parts import Outline, Pane, Plane, Point, Rectangle, extent
from taichi_plume.execution.latest_instant import Instant, Picture
from taichi_plume.report import theme
from taichi_plume.report.theme import ABOVE, FRONT, SIDE

MARGIN = 0.08  # of the longer side, around the room
NEAR = 10.0  # pixels from a handle within which the pointer takes the handle
USUAL_SIZE = (600.0, 450.0)  # pixels
NAMES = {ABOVE: "above", SIDE: "side", FRONT: "front"}
HIGHEST = 0.5  # of the height of the plan and the view below it: most of that view
SETTLED = 200  # ms from a size of a figure to the last one
BORDERS = (10, 50)  # pixels, above and below the inner part
LOWEST = 60.0  # pixels: least height of that view
WHEEL = 600.0  # of a turned wheel, as Bokeh's tool has it: to zoom by all
LABELS = 2.0  # pixels by which the figure's inner part may change without being fitted again
ARROW = 0.05  # of the longer side: an arrow of the fastest wind
FINE = 200  # pixels along the longer side of a picture, at least half of them
DIGITS = 6  # of sent positions [m]
SHORT = 500  # numbers of an array that is sent within a message
FONT = "Helvetica, Arial, sans-serif"
COORDINATES = ("x", "y", "x0", "y0", "x1", "y1", "xs", "ys", "dw", "dh", "width", "height", "image")
View = tuple[tuple[float, float], ...]
CHOSEN, WRONG, UNLIKELY = "#0b6bcb", theme.ERROR, theme.UNLIKELY
GUIDE = "#c2185b"
FADED = 0.3  # opacity of what the room of a run that is seen lacks, over its usual one
AT_START = 0.15  # opacity of a walker's start while the walker of a run is drawn
SHAPE = "xs ys color alpha edge width path"
TEXT = {"text": "text", "text_font": value(FONT), "text_font_size": "11px", "text_align": "center"}
LAYERS: dict[str, tuple[str, str, dict[str, Any]]] = {
    "floor": ("rect", "x y width height", {"fill_color": "#ffffff", "line_color": None, "level": "image"}),
    "image": ("image_rgba", "image x y dw dh", {"level": "image"}),
    "values": ("image", "image x y dw dh", {"level": "image", "palette": ["#ffffff"], "global_alpha": 0.0}),
    "wind": ("segment", "x0 y0 x1 y1", {"line_color": theme.WIND, "line_alpha": 0.45}),
    "areas": (
        "patches", SHAPE,
        {"fill_color": "color", "fill_alpha": "alpha", "line_color": "edge", "line_width": "width"},
    ),
    "trails": ("multi_line", "xs ys color", {"line_color": "color", "line_width": 1.5, "line_alpha": 0.7}),
    "walkers": (
        "patches", "xs ys", {"fill_color": theme.SOLID, "fill_alpha": 0.95, "line_color": theme.SOLID_EDGE}
    ),
    "earlier": ("multi_line", "xs ys", {"line_color": "#000000", "line_width": 2, "line_dash": "dashed"}),
    "lines": ("multi_line", SHAPE, {"line_color": "edge", "line_width": "width", "line_alpha": "alpha"}),
    "flows": (
        "scatter", "x y angle color",
        {"marker": "triangle", "size": 11, "angle": "angle", "fill_color": "color", "line_color": None},
    ),
    "headings": ("segment", "x0 y0 x1 y1 color", {"line_color": "color", "line_width": 3}),
    "robots": (
        "scatter", "x y color", {"size": 13, "fill_color": "color", "line_color": "#ffffff", "line_width": 1.5}
    ),
    "guides": ("multi_line", "xs ys", {"line_color": GUIDE, "line_width": 1}),
    "sketch": ("line", "x y", {"line_color": CHOSEN, "line_dash": "dashed", "line_width": 2}),
    "labels": (
        "text", "x y text color", {**TEXT, "text_color": "color", "text_baseline": "top", "y_offset": 3}
    ),
    "handles": (
        "scatter", "x y name marker",
        {"marker": "marker", "size": 9, "fill_color": "#ffffff", "line_color": CHOSEN, "line_width": 2},
    ),
    "size": (
        "text", "x y text",
        {
            **TEXT, "text_color": "#ffffff", "background_fill_color": CHOSEN, "padding": 3, "border_radius": 3,
            "x_offset": 14, "y_offset": -14, "text_align": "left",
        },
    ),
    "marks": ("scatter", "x y text color", {"size": 18, "fill_color": "color", "line_color": "#ffffff"}),
}  # fmt: skip
"""Layers of a view, the lowest first: method of the figure, columns of the source, and style by values or columns."""


class Canvas:
    """A figure of one plane. `show` draws objects, `show_run` the state of a run below them.

    leader: another canvas, whose ranges and whose scale of the wind this one has, to be compared with it.
    plan: canvas from above, for a view from the side, which has its scale and, in x, its range. A room that is too high
    for that is squeezed.
    """

    def __init__(self, plane: Plane, leader: "Canvas | None" = None, plan: "Canvas | None" = None):
        self.plane, self.leader, self.plan = plane, leader, plan
        above = leader or (plan if plane == SIDE else None)
        x_range = above.figure.x_range if above is not None else Range1d(start=-0.3, end=4.3)
        y_range = leader.figure.y_range if leader is not None else Range1d(start=-0.3, end=3.3)
        self.figure = figure(
            x_range=x_range, y_range=y_range, tools="", toolbar_location=None,
            sizing_mode="stretch_both", min_border_left=70, min_border_top=BORDERS[0], min_border_bottom=BORDERS[1],
            min_border_right=10, output_backend="canvas", x_axis_label=f"{'xyz'[plane[0]]} [m]",
            y_axis_label=f"{'xyz'[plane[1]]} [m]", name="beside" if leader else NAMES[plane],
        )  # fmt: skip
        self.figure.context_menu = None  # the page has its own
        if plan is None:
            wheel = WheelZoomTool()
            self.figure.add_tools(wheel)
            self.figure.toolbar.active_scroll = wheel
        else:  # the tool would leave the plan's other axis as it is
            self.figure.on_event(
                MouseWheel, lambda e: self.zoom((e.x, e.y), 1 - np.clip(e.delta / WHEEL, -0.5, 0.5))
            )
            for range_ in (plan.figure.x_range, plan.figure.y_range):
                for end in ("start", "end"):
                    range_.on_change(end, lambda _attr, _old, _new: self._follow())
            plan.figure.on_change("inner_height", lambda _attr, _old, _new: self._settle())
        self.figure.toolbar.active_drag = None
        self.room: tuple[float, ...] | None = None
        self._fitted = USUAL_SIZE
        self._changes = 0  # of sizes of a view from the side and its plan
        self.sight: Instant | None = None
        self.arrow = 0.0
        """Length of the lines of the wind [m per m/s]."""
        self.faded: frozenset[str] = frozenset()
        """Paths of objects that the room of the run that is seen lacks, or has otherwise."""
        self._beside: tuple[object, ...] = (None, None, None, None)
        for name in ("inner_width", "inner_height"):
            self.figure.on_change(name, lambda _attr, _old, _new: self._resized())
        self._style()
        self.sources: dict[str, ColumnDataSource] = {}
        self._shown: dict[str, list[tuple]] = {}  # rows of the layers
        for name, (method, columns, style) in LAYERS.items():
            keys = columns.split()
            source = self.sources[name] = ColumnDataSource({key: [] for key in keys})
            given = {key: key for key in keys if key in COORDINATES}
            getattr(self.figure, method)(source=source, **given, **style)
        read: Any = [each for each in self.figure.renderers if each.data_source is self.sources["values"]]
        self.reader = HoverTool(
            renderers=read, formatters={"@image": "printf"}, attachment="above", visible=False
        )
        self.figure.add_tools(self.reader)
        self.figure.text(
            "x", "y", source=self.sources["marks"], text_color="#ffffff", text_baseline="middle",
            text_font_style="bold", **TEXT,
        )  # fmt: skip
        self.sources["image"].name = None if leader or plane != ABOVE else "gas"
        self.note = Label(
            x=6, y=6, x_units="screen", y_units="screen", text="", text_color=UNLIKELY, text_font=FONT,
            text_font_size="12px", background_fill_color="#ffffff", background_fill_alpha=0.9,
        )  # fmt: skip
        self.figure.add_layout(self.note)
        self.bar = ColorBar(
            color_mapper=LinearColorMapper(palette=["#ffffff"], low=0.0, high=1.0), visible=False, location="top_right",
            orientation="horizontal", width=230, height=8, padding=6, margin=4, title_text_font=FONT,
            major_label_text_font=FONT, background_fill_alpha=0.8, name="bar",
        )  # fmt: skip
        self.figure.add_layout(self.bar, "center")
        self._scale: tuple[object, ...] = ()

    def _fill(self, layer: str, rows: Iterable[Any] = ()) -> None:
        """Show rows of values in a layer, in the order of the layer's columns; only rows that differ are sent."""
        rows, shown = [tuple(row) for row in rows], self._shown.get(layer, [])
        keys, source = LAYERS[layer][1].split(), self.sources[layer]
        differ = [n for n, (a, b) in enumerate(zip(rows, shown, strict=False)) if not _alike(a, b)]
        self._shown[layer] = rows
        if len(rows) != len(shown) or 2 * len(differ) > len(rows):
            source.data = {key: [_sent(row[n]) for row in rows] for n, key in enumerate(keys)}
        elif differ:
            source.patch({key: [(row, _sent(rows[row][n])) for row in differ] for n, key in enumerate(keys)})

    def _style(self) -> None:
        plot: Any = self.figure
        plot.grid.grid_line_alpha, plot.grid.level, plot.outline_line_color = 0.6, "underlay", None
        for axis in plot.axis:
            axis.axis_label_text_font = axis.major_label_text_font = FONT
            axis.axis_label_text_font_style = "normal"
            axis.axis_line_color = axis.minor_tick_line_color = None
        plot.title.text_font = FONT
        paint(plot, False)

    # ---------------------------------------------------------------- objects

    def show(
        self,
        of: Scene,
        chosen: Sequence[str] = (),
        wrong: Collection[str] = (),
        marks: Sequence[tuple[str, Point, bool]] = (),
    ) -> None:
        """Draw the objects of a text. chosen, wrong: paths of objects; marks: (number, position, is error)."""
        if self.plane not in of.planes or not self.figure.visible:
            return
        if of.room != self.room:
            self.room = of.room
            self.fit()
        width, height = (of.room[d] for d in self.plane) if of.room else (0.0, 0.0)
        self._fill("floor", [(width / 2, height / 2, width, height)])
        areas, lines, labels = [], [], []
        for thing in of.things:
            outlines = thing.outlines(self.plane)
            for points, closed in outlines:
                is_line = not closed or thing.path == "domain"
                points = np.concatenate([points, points[:1]]) if closed and is_line else points
                look = self._look(thing, closed, chosen, wrong)
                (lines if is_line else areas).append((*points.T.copy(), thing.color, *look, thing.path))
            if outlines and self.plane == ABOVE and thing.path not in ("domain", "arena"):
                x, y = self._label_place(thing, outlines)
                labels.append((x, y, thing.name, theme.INK))
        self._fill("flows", self._flows(of))
        self._fill("areas", areas)
        self._fill("lines", lines)
        self._fill("labels", labels)
        self._fill("marks", ((*at, text, WRONG if is_error else UNLIKELY) for text, at, is_error in marks))
        self._show_handles(of, chosen)

    def _look(
        self, thing: Thing, closed: bool, chosen: Collection[str], wrong: Collection[str]
    ) -> tuple[float, str, float]:
        """Return opacity, colour of the edge and width of the edge of an object."""
        kind = thing.path.partition("[")[0]
        alpha = {"obstacles": 0.95, "arena": 0.0}.get(kind, 0.6 if kind.startswith("gas") else 0.35)
        edge = {"obstacles": theme.SOLID_EDGE, "domain": theme.INK}.get(kind, thing.color)
        width = 2.0 if kind == "domain" else 1.0 if closed else 7.0 if kind == "wind.openings" else 1.5
        if thing.path in wrong:
            edge, width = WRONG, max(width, 2.5)
        if thing.path in chosen:
            edge, width = CHOSEN, max(width, 2.5)
        if kind == "robots" and isinstance(thing.part, Rectangle):
            alpha = 0.2  # an area of starts
        if self.sight is not None and thing.part is not None and thing.part.walks:
            alpha = AT_START
        if thing.path in self.faded and thing.path not in chosen:
            alpha *= FADED
        return alpha if closed else 1.0, edge, width

    def _label_place(self, thing: Thing, outlines: Sequence[Outline]) -> Point:
        """Return the position of an object's name: below the areas of the object, and within the room."""
        closed = [outline.points for outline in outlines if outline.closed]
        points = np.concatenate(closed or [outlines[0].points])
        low, high = np.nanmin(points, axis=0), np.nanmax(points, axis=0)
        x, y = float(low[0] + high[0]) / 2, float(low[1])
        if thing.path.startswith("wind.") and self.room is not None:
            y = min(max(y, 0.06 * self.room[1]), 0.97 * self.room[1])
            x = min(max(x, 0.08 * self.room[0]), 0.92 * self.room[0])
        return x, y

    def _flows(self, of: Scene) -> Iterator[tuple[float, float, float, str]]:
        """Yield arrowheads along the openings through which air comes in (inward) or leaves (outward)."""
        for thing in of.things:
            model: Any = thing.part.model if thing.part is not None else None
            if not thing.path.startswith("wind.openings") or model is None or not model.passes:
                continue
            if model.normal not in self.plane:
                continue
            (a, b), longest = thing.outlines(self.plane)[0].points, max(of.room or (1.0,))
            inward = -model.direction if model.side else model.direction
            across = self.plane.index(model.normal)  # axis of the plane
            angle = across * pi / 2 + (0 if inward > 0 else pi)
            count = max(1, min(6, round(float(np.hypot(*(b - a))) / (0.12 * longest))))
            for n in range(count):
                at = a + (n + 0.5) / count * (b - a)
                at[across] += 0.3 * ARROW * longest * inward
                yield float(at[0]), float(at[1]), angle - pi / 2, thing.color

    def _show_handles(self, of: Scene, chosen: Sequence[str]) -> None:
        """Draw the handles of the only chosen object or, if none is chosen, those of the room."""
        round_ones = ("center", "turn")
        self._fill(
            "handles",
            (
                (*at, name, "circle" if name in round_ones else "square")
                for _, name, at in self._handles(of, chosen)
            ),
        )

    def _handles(self, of: Scene, chosen: Sequence[str]) -> list[tuple[str, str, Point]]:
        """Return (path, name, position) of the handles that are shown; see `_show_handles`.

        Handles of a room that is not chosen are shown where no object would be dragged instead, such as an opening
        that is not as wide as its wall.
        """
        thing = of.thing(chosen[0] if chosen else "domain") if len(chosen) < 2 else None
        handles = thing.handles(self.plane) if thing is not None else {}

        def is_free(at: Point) -> bool:
            path = self.thing_at(of, at)
            other = None if path is None else of.thing(path)
            return other is None or (isinstance(other.part, Pane) and other.part.model.center is None)

        free = [(name, at) for name, at in handles.items() if chosen or is_free(at)]
        return [(thing.path, name, at) for name, at in free] if thing is not None else []

    def sketch(self, points: Sequence[Point]) -> None:
        """Draw the line of an object that is being drawn, or of a rectangle that selects."""
        self._fill("sketch", points)

    def show_aids(self, at: Point = (0.0, 0.0), text: str = "", guides: Iterable[Any] = ()) -> None:
        """Show a size or a position beside the pointer, and the guides that attract; by default neither."""
        self._fill("size", [(*at, text)] if text else [])
        self._fill("guides", guides)

    @property
    def pixels(self) -> tuple[float, float]:
        """Width and height of the figure's inner part [pixels]."""
        try:
            return max(50.0, self.figure.inner_width), max(50.0, self.figure.inner_height)
        except UnsetValueError:  # no browser has drawn the figure yet
            height = (self.figure.height or 0) - sum(BORDERS)
            return USUAL_SIZE[0], USUAL_SIZE[1] if self.plan is None else height

    def fit(self) -> None:
        """Show the whole room, at the same scale along both axes."""
        if self.room is None or self.leader is not None:
            return
        self._fitted = self.pixels
        if self.plan is not None:
            self._follow(self.room[2] / 2)
            self._settle()
            return
        step = self._whole
        for range_, d, count in zip(self._ranges, self.plane, self.pixels, strict=True):
            _center(range_, self.room[d] / 2, step * count)

    @property
    def _ranges(self) -> tuple[Any, Any]:
        """Ranges along both axes."""
        return self.figure.x_range, self.figure.y_range

    @property
    def _sides(self) -> np.ndarray:
        """Length of the room along each axis, with margins [m]."""
        assert self.room is not None
        return np.array(self.room) + 2 * MARGIN * max(self.room[:2])

    @property
    def _whole(self) -> float:
        """Size of a pixel [m] at which the plan has the whole room."""
        return float(max(self._sides[:2] / self.pixels))

    def _settle(self) -> None:
        """Share the height with the plan a little later: the sizes of figures arrive one by one."""
        self._changes += 1
        number = self._changes
        if self.figure.document is None:
            self._share_height(number)
        else:
            self.figure.document.add_timeout_callback(lambda: self._share_height(number), SETTLED)

    def _share_height(self, number: int) -> None:
        """Give this view the height of the room at the scale at which plan and view together have the whole room.

        number: of the last change of a size; without effect if there has been another one since.
        """
        plan = self.plan
        if number != self._changes or plan is None or self.room is None or not self.figure.visible:
            return
        (width, above), own = plan.pixels, self.pixels[1]
        x, y, z = self._sides
        step = max(x / width, (y + z) / (above + own))
        share = min(max(z / step, LOWEST), HIGHEST * (above + own))
        if abs(share - own) > LABELS:
            self.figure.height = round(share) + sum(BORDERS)
            self._follow()

    def _follow(self, middle: float | None = None) -> None:
        """Take the scale and the position of the plan. middle: height [m] at the middle of the view; None: as it is."""
        plan = self.plan
        if plan is None or plan.room is None or self.room is None or not self.figure.visible:
            return
        step, (width, height) = plan.pixel(), self.pixels
        if self.plane == FRONT:
            _center(self.figure.x_range, _middle(plan.figure.y_range), step * width)
        squeezed = max(1.0, (1 + MARGIN) * self.room[2] / (height * plan._whole))
        z = self.figure.y_range
        _center(z, _middle(z) if middle is None else middle, step * height * squeezed)

    def zoom(self, at: Point, factor: float) -> None:
        """Show a length that is larger by a factor, in the plan too; the point stays where it is."""
        plan = self.plan
        assert plan is not None
        z = _middle(self.figure.y_range)
        self._follow(at[1] - (at[1] - z) * factor)
        for axis, range_ in enumerate(plan._ranges):
            middle, length = _middle(range_), range_.end - range_.start
            fixed = at[0] if axis == self.plane[0] else middle
            _center(range_, fixed - (fixed - middle) * factor, length * factor)

    def _resized(self) -> None:
        """Show the whole room again if the figure has another size, not only other labels at its axes."""
        if max(abs(a - b) for a, b in zip(self.pixels, self._fitted, strict=True)) > LABELS:
            self.fit()

    def pixel(self) -> float:
        """Return the size of a pixel [m]."""
        return abs(self.figure.x_range.end - self.figure.x_range.start) / self.pixels[0]

    @property
    def view(self) -> View:
        """Ends of the ranges along both axes [m]."""
        return tuple((range_.start, range_.end) for range_ in (self.figure.x_range, self.figure.y_range))

    def pan(self, view: View, dx: float, dy: float) -> None:
        """Show a view moved by pixels."""
        for range_, (start, end), by, count in zip(self._ranges, view, (-dx, dy), self.pixels, strict=True):
            shift = by * (end - start) / count
            range_.update(start=start + shift, end=end + shift)
        if self.plan is not None and self.plane == FRONT:
            y = self.plan.figure.y_range
            _center(y, _middle(self.figure.x_range), y.end - y.start)

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
        if not self.figure.visible:
            return
        beside = (of, present, picture, self.leader and self.leader.arrow)
        if sight is self.sight and all(a is b for a, b in zip(beside, self._beside, strict=True)):
            return
        self.sight, self._beside = sight, beside
        seen = sight is not None and of is not None and of.room is not None and self.plane in of.planes
        if not seen or sight is None or of is None or of.room is None:
            for layer in ("image", "values", "wind", "trails", "headings", "robots", "walkers", "earlier"):
                self._fill(layer)
            self.note.text, self.bar.visible = "", False
            return
        walking = [thing.part for thing in of.things if thing.part is not None and thing.part.walks]
        self._fill("walkers", (part.outline_at(sight.t, self.plane).points.T for part in walking))
        self._show_room(of, present if present is not None else of, name)
        if self.plane == ABOVE:
            self._show_air(sight, picture, of.room)

    def _show_room(self, of: Scene, present: Scene, name: str) -> None:
        """Draw what differs between the room of a run and the present one, and say whose gas is seen."""
        lines = [
            np.concatenate([points, points[:1]]) if closed else points
            for thing in of.drawn_otherwise(present)
            for points, closed in thing.outlines(self.plane)
        ]
        self._fill("earlier", (points.T for points in lines))
        self.note.text = ""
        if of.data != present.data:
            dashed = "; dashed: its room" if lines else ""
            faded = "; faded: changed since" if self.faded else ""
            self.note.text = f"Gas, wind and robots: {name}, started before your last changes{dashed}{faded}"

    def _show_air(self, sight: Instant, picture: Picture | None, room: tuple[float, ...]) -> None:
        height, width = (n * picture.cell for n in picture.values.shape) if picture is not None else (0, 0)
        at = (0.0, 0.0, width, height)
        self._fill("image", [(_colors(picture), *at)] if picture is not None else [])
        self._fill("values", [(picture.values, *at)] if picture is not None else [])
        self._show_scale(picture)
        x, y, u, v = sight.wind(picture)
        own = ARROW * max(room[:2]) / max(float(np.hypot(u, v).max(initial=0.0)), 1e-9)
        self.arrow = self.leader.arrow if self.leader is not None else own
        half = 0.5 * self.arrow
        self._fill("wind", np.transpose([x - half * u, y - half * v, x + half * u, y + half * v]))
        x, y, heading = sight.robots
        colors, reach = [theme.robot(n) for n in range(len(x))], 0.03 * max(room[:2])
        ends = x + reach * np.cos(heading), y + reach * np.sin(heading)
        self._fill("trails", ((*way, color) for way, color in zip(sight.trails, colors, strict=False)))
        self._fill("headings", zip(x, y, *ends, colors, strict=True))
        self._fill("robots", zip(x, y, colors, strict=True))

    def _show_scale(self, picture: Picture | None) -> None:
        """Show the colours of a picture as a bar with its quantity and unit."""
        self.bar.visible = picture is not None
        scale = (picture.quantity, picture.unit, picture.scale) if picture is not None else ()
        if picture is None or scale == self._scale:
            return
        self._scale = scale
        kind = LogColorMapper if picture.scale.kind == "log" else LinearColorMapper
        colors = theme.colors_of(picture.unit)(np.arange(256))
        palette = [
            f"#{r:02x}{g:02x}{b:02x}" for r, g, b in (255 * colors[:, :3]).round().astype(int).tolist()
        ]
        self.bar.color_mapper = kind(palette=palette, low=picture.scale.low, high=picture.scale.high)
        self.bar.title = picture.quantity + (f" [{picture.unit}]" if picture.unit != "1" else "")
        self.reader.tooltips = [
            (picture.quantity, f"@image{{%.3g}} {picture.unit}"),
            ("at", "$x{0.00}, $y{0.00} m"),
        ]

    # ---------------------------------------------------------------- pointing

    def handle_at(self, of: Scene, chosen: Sequence[str], at: Point) -> tuple[str, str] | None:
        """Return path and handle of the shown handle near a point, the nearest first; None if there is none near."""
        apart = {
            (path, name): float(np.hypot(x - at[0], y - at[1]))
            for path, name, (x, y) in self._handles(of, chosen)
        }
        nearest = min(apart, key=apart.__getitem__, default=None)
        return nearest if nearest is not None and apart[nearest] <= NEAR * self.pixel() else None

    def wall_at(self, of: Scene, at: Point) -> str:
        """Return the path of the room, "domain", near one of its walls; "" elsewhere."""
        outlines = [
            points
            for thing in of.things
            if thing.path == "domain"
            for points, _ in thing.outlines(self.plane)
        ]
        near = NEAR * self.pixel()
        return "domain" if any(_distance(points, at, True) <= near for points in outlines) else ""

    def things_within(self, of: Scene, a: Point, b: Point) -> list[str]:
        """Return the paths of the objects within a rectangle; a, b: opposite corners [m]."""
        low, high = np.minimum(a, b), np.maximum(a, b)
        boxes = {thing.path: extent(o) for thing in of.things if (o := thing.outlines(self.plane))}
        within = [path for path, box in boxes.items() if (box >= low).all() and (box <= high).all()]
        return [path for path in within if path not in ("domain", "arena")]

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


def _middle(range_: Any) -> float:
    return (range_.start + range_.end) / 2


def _center(range_: Any, middle: float, length: float) -> None:
    """Show a length around a middle [m]."""
    range_.update(start=middle - length / 2, end=middle + length / 2)


def _sent(value: Any) -> Any:
    """Return a value in the form in which it is sent: a short list of positions not as a message of its own."""
    is_short = isinstance(value, np.ndarray) and value.ndim == 1 and len(value) <= SHORT
    return value.round(DIGITS).tolist() if is_short else value


def paint(plot: Any, dark: bool) -> None:
    """Colour a figure for a dark or a light page."""
    desk, paper, lines, letters = (
        ("#12161a", "#12161a", "#434d58", "#a3afbb") if dark else ("#e9edf1", "#f3f5f7", "#c5cdd6", "#586473")
    )
    plot.update(background_fill_color=desk, border_fill_color=paper)
    plot.grid.grid_line_color = lines
    for axis in plot.axis:
        axis.axis_label_text_color = axis.major_label_text_color = letters
        axis.major_tick_line_color = lines


def _alike(a: Sequence[Any], b: Sequence[Any]) -> bool:
    """Return whether two rows, or lists of rows, of texts, numbers and arrays are equal."""
    return len(a) == len(b) and all(
        np.array_equal(x, y, equal_nan=x.dtype.kind == "f")
        if isinstance(x, np.ndarray) and isinstance(y, np.ndarray)
        else _alike(x, y)
        if isinstance(x, tuple) and isinstance(y, tuple)
        else bool(x == y)
        for x, y in zip(a, b, strict=True)
    )


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


def _inside(points: np.ndarray, at: Point) -> bool:
    """Return whether a point lies in polygons separated by rows of NaN, by the even-odd rule, as Bokeh fills them."""
    a, b = _edges(points, True)
    crossed = (a[:, 1] > at[1]) != (b[:, 1] > at[1])
    (x, y), (dx, dy) = a[crossed].T, (b - a)[crossed].T
    return bool(np.count_nonzero(at[0] < x + (at[1] - y) / dy * dx) % 2)


def _edges(points: np.ndarray, closed: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return the starts (n, 2) and ends (n, 2) of the edges of polygons or lines separated by rows of NaN."""
    gaps = np.flatnonzero(np.isnan(points[:, 0]))
    parts = [part[~np.isnan(part[:, 0])] for part in np.split(points, gaps)]
    starts = [part if closed else part[:-1] for part in parts]
    ends = [np.roll(part, -1, axis=0) if closed else part[1:] for part in parts]
    return np.concatenate(starts), np.concatenate(ends)


def _distance(points: np.ndarray, at: Point, closed: bool) -> float:
    """Return the distance of a point from the edges of an outline."""
    a, b = _edges(points, closed)
    along = b - a
    part = ((at - a) * along).sum(axis=1) / np.maximum((along**2).sum(axis=1), 1e-18)
    nearest = a + np.clip(part, 0.0, 1.0)[:, None] * along
    return float(np.hypot(*(nearest - at).T).min(initial=np.inf))
