"""Actions of the pointer in the views: select, move, resize, draw, and move the view."""

from collections.abc import Callable, Sequence
from html import escape
from pathlib import Path
from typing import Any, NamedTuple

from bokeh.events import DoubleTap, Pan, PanEnd, PanStart, Tap
from bokeh.models import Div, RadioButtonGroup, Select

from taichi_plume.draw import edits
from taichi_plume.draw.canvas import Canvas
from taichi_plume.draw.document import data_of
from taichi_plume.draw.objects import Scene, preview
from taichi_plume.draw.parts import Plane, Point
from taichi_plume.draw.workplace import Workplace
from taichi_plume.guard.yaml_text import LineError, read_text
from taichi_plume.report.theme import ABOVE

STEPS = {"1 cm": 0.01, "5 cm": 0.05, "10 cm": 0.1, "25 cm": 0.25, "off": 0.0}
"""Steps of the grid to which the pointer snaps [m], by their labels; 0: none."""


class Drag(NamedTuple):
    """A drag that has begun. path, handle: of the dragged object; "" for the view or a new object.

    start: where the pointer went down; offset: from there to the handle.
    """

    canvas: Canvas
    path: str
    handle: str | None
    start: Point
    offset: Point = (0.0, 0.0)


class Pointer:
    """Base class of the page: what its attributes do when the pointer acts in a view."""

    workplace: Workplace
    scene: Scene
    chosen: str
    canvases: dict[Plane, Canvas]
    palette: RadioButtonGroup
    step: Select
    file: Select
    hint: Div
    choose: Callable[[str], None]
    put: Callable[[str], None]
    say: Callable[[str], None]
    refresh: Callable[[], None]
    tried: Callable[[Callable[[], Any]], Any]
    edit: Callable[[Callable[[], str]], None]

    def __init__(self) -> None:
        self.dragged: Drag | None = None
        self.points: list[Point] = []

    def listen(self, canvas: Canvas) -> None:
        """Attend to the pointer in a view; before the view joins the document."""
        plot = canvas.figure
        plot.on_event(Tap, lambda event: self._tap(canvas, (event.x, event.y)))
        plot.on_event(DoubleTap, lambda event: self._double_tap(canvas, (event.x, event.y)))
        plot.on_event(PanStart, lambda event: self._start(canvas, (event.x, event.y)))
        plot.on_event(
            Pan, lambda event: self._drag(canvas, (event.x, event.y), (event.delta_x, event.delta_y))
        )
        plot.on_event(PanEnd, lambda event: self._end(canvas, (event.x, event.y)))

    @property
    def kind(self) -> str:
        """Kind of object that the pointer draws; "select" if it selects and moves."""
        return ["select", *edits.KINDS][self.palette.active or 0]

    @property
    def usage(self) -> str:
        """Use of the pointer in the views, as HTML."""
        return escape(
            edits.KINDS.get(self.kind, "Drag an object or its handles; drag the floor to move the view.")
        )

    def _tool_changed(self) -> None:
        self.points = []
        self.hint.text = self.usage
        endings = {"mesh": (".stl", ".obj", ".ply"), "map": (".yaml", ".yml")}.get(self.kind, ())
        files = sorted(
            f.name
            for f in self.workplace.folder.iterdir()
            if f.suffix.lower() in endings
            and not f.name.startswith(".")
            and (self.kind != "map" or _is_map(f))
        )
        self.file.update(visible=bool(endings), options=files, value=files[0] if files else "")
        for canvas in self.canvases.values():
            canvas.sketch([])

    def _snapped(self, at: Point) -> Point:
        return edits.snapped(at, STEPS[self.step.value])

    def _tap(self, canvas: Canvas, at: Point) -> None:
        if self.kind == "select":
            self.choose(canvas.thing_at(self.scene, at) or "")
        elif canvas.plane != ABOVE:
            self.say("draw in the view from above; heights are set in the view from the side afterwards")
        elif self.kind in edits.CLICKED:
            self.points.append(self._snapped(at))
            canvas.sketch(self.points)
        else:
            self._create([self._snapped(at)])

    def _double_tap(self, canvas: Canvas, at: Point) -> None:
        """End a polygon or a path; two quick clicks at different places are clicks (to Bokeh, a double one)."""
        if self.kind not in edits.CLICKED or not self.points or canvas.apart(self.points[-1], at):
            self._tap(canvas, at)
            return
        corners = [p for n, p in enumerate(self.points) if n == 0 or p != self.points[n - 1]]
        self._create(corners)

    def _create(self, points: Sequence[Point]) -> None:
        made = self.tried(
            lambda: edits.create(
                self.workplace.text, self.scene, self.kind, points, self.chosen, self.file.value
            )
        )
        self.points = []
        self.canvases[ABOVE].sketch([])
        if made is not None:
            text, self.chosen = made
            self.put(text)
            if self.kind in ("mesh", "map", "arena"):
                self.palette.active = 0

    def _start(self, canvas: Canvas, at: Point) -> None:
        if self.kind != "select":
            self.dragged = Drag(canvas, "", None, at) if canvas.plane == ABOVE else None
            return
        chosen = self.scene.thing(self.chosen)
        handle = canvas.handle_at(chosen, at)
        if handle is None:
            path = canvas.thing_at(self.scene, at)
            if path is None:
                self.dragged = Drag(canvas, "", None, at)
                return
            if path != self.chosen:
                self.choose(path)
            thing = self.scene.thing(path)
            handles = thing.handles(canvas.plane) if thing is not None else {}
            handle = "center" if "center" in handles else next(iter(handles)) if len(handles) == 1 else None
            if thing is None or handle is None:
                return
            x, y = handles[handle]
            self.dragged = Drag(canvas, path, handle, at, (x - at[0], y - at[1]))
            return
        self.dragged = Drag(canvas, self.chosen, handle, at)

    def _target(self, at: Point) -> Point:
        assert self.dragged is not None
        x, y = self.dragged.offset
        return self._snapped((at[0] + x, at[1] + y))

    def _drag(self, canvas: Canvas, at: Point, by: Point) -> None:
        if self.dragged is None:
            return
        _, path, handle, start, _ = self.dragged
        if self.kind != "select":
            canvas.sketch(self._outline(self._snapped(start), self._snapped(at)))
        elif not path:
            canvas.pan(*by)
        elif handle is not None:
            self._preview(canvas.plane, path, handle, self._target(at))

    def _outline(self, a: Point, b: Point) -> list[Point]:
        if self.kind in ("box", "robot area", "arena"):
            return [a, (b[0], a[1]), b, (a[0], b[1]), a]
        return [a, b]

    def _preview(self, plane: Plane, path: str, handle: str, to: Point) -> None:
        thing = self.scene.thing(path)
        if thing is None or thing.part is None:
            return
        moved = preview(self.scene, path, thing.part.moved(handle, plane, to), self.workplace.folder)
        if moved is not None and moved.part is not None:
            shown = self.scene.with_thing(moved)
            for canvas in self.canvases.values():
                canvas.show(shown, path)

    def _end(self, canvas: Canvas, at: Point) -> None:
        dragged, target = self.dragged, self._target(at) if self.dragged else at
        self.dragged = None
        if dragged is None:
            return
        _, path, handle, start, _ = dragged
        if self.kind != "select":
            self._create([self._snapped(start), self._snapped(at)])
        elif path and handle is not None:
            self.edit(
                lambda: edits.move_handle(self.workplace.text, self.scene, path, handle, canvas.plane, target)
            )
            self.refresh()


def _is_map(file: Path) -> bool:
    """Return whether a YAML file is a map of ROS's map_server: scenarios lie beside it."""
    try:
        return "image" in data_of(read_text(file))
    except (LineError, OSError):
        return False
