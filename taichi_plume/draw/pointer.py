"""Actions of the pointer in the views: select, move, resize, draw, and move the view."""

from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from bokeh.events import DoubleTap, Pan, PanEnd, PanStart, Tap
from bokeh.models import InlineStyleSheet, RadioButtonGroup, Select

from taichi_plume.draw import edits
from taichi_plume.draw.canvas import Canvas
from taichi_plume.draw.document import data_of
from taichi_plume.draw.objects import preview
from taichi_plume.draw.parts import Plane, Point
from taichi_plume.guard.yaml_text import LineError, read_text
from taichi_plume.report.theme import ABOVE

if TYPE_CHECKING:
    from taichi_plume.draw.page import Page

STEPS = {"1 cm": 0.01, "5 cm": 0.05, "10 cm": 0.1, "25 cm": 0.25, "off": 0.0}
"""Steps of the grid to which the pointer snaps [m], by their labels; 0: none."""
FILES = {"mesh": (".stl", ".obj", ".ply"), "map": (".yaml", ".yml")}
"""Endings of the files of which the drawn kinds are made."""


class Drag(NamedTuple):
    """A drag that has begun. path, handle: of the dragged object; "" for the view or a new object.

    start: where the pointer went down; offset: from there to the handle.
    """

    path: str
    handle: str
    start: Point
    offset: Point = (0.0, 0.0)


class Pointer:
    """Pointer in the views of a page, with the palette of kinds that it draws, and the step of its grid."""

    def __init__(self, page: "Page", sheet: InlineStyleSheet):
        self.page = page
        self.dragged: Drag | None = None
        self.points: list[Point] = []
        self.step = Select(options=list(STEPS), value="5 cm", width=80)
        self.file = Select(title="file", width=110, visible=False)
        self.palette = RadioButtonGroup(
            labels=["select", *edits.KINDS], active=0, orientation="vertical", width=110, stylesheets=[sheet]
        )
        self.palette.on_change("active", lambda _attr, _old, _new: self._tool_changed())
        for canvas in page.canvases.values():
            self._listen(canvas)

    def _listen(self, canvas: Canvas) -> None:
        """Attend to the pointer in a view; before the view joins the document: Bokeh learns of callbacks then."""
        plot = canvas.figure
        plot.on_event(Tap, lambda event: self.tap(canvas, (event.x, event.y)))
        plot.on_event(DoubleTap, lambda event: self.double_tap(canvas, (event.x, event.y)))
        plot.on_event(PanStart, lambda event: self.start(canvas, (event.x, event.y)))
        plot.on_event(
            Pan, lambda event: self.drag(canvas, (event.x, event.y), (event.delta_x, event.delta_y))
        )
        plot.on_event(PanEnd, lambda event: self.end(canvas, (event.x, event.y)))

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

    def take(self, kind: str) -> None:
        """Choose a kind of the palette."""
        if kind in edits.KINDS:
            self.palette.active = 1 + list(edits.KINDS).index(kind)

    def _tool_changed(self) -> None:
        self._forget()
        endings = FILES.get(self.kind, ())
        files = sorted(
            f.name
            for f in self.page.workplace.folder.iterdir()
            if f.suffix.lower() in endings
            and not f.name.startswith(".")
            and (self.kind != "map" or _is_map(f))
        )
        self.file.update(visible=bool(endings), options=files, value=files[0] if files else "")
        self.page.look()

    def _forget(self) -> None:
        """Forget what has been drawn of a new object."""
        self.points = []
        self.page.canvases[ABOVE].sketch([])

    def _snapped(self, at: Point) -> Point:
        return edits.snapped(at, STEPS[self.step.value])

    def tap(self, canvas: Canvas, at: Point) -> None:
        """Select the object at a point, or draw there."""
        if self.kind == "select":
            self.page.choose(canvas.thing_at(self.page.scene, at) or "")
        elif canvas.plane != ABOVE:
            self.page.say("draw in the view from above; heights are set in the view from the side afterwards")
        elif self.kind in edits.CLICKED:
            self.points.append(self._snapped(at))
            canvas.sketch(self.points)
        else:
            self._create([self._snapped(at)])

    def double_tap(self, canvas: Canvas, at: Point) -> None:
        """End a polygon or a path; two quick clicks at different places are clicks (to Bokeh, a double one)."""
        if self.kind not in edits.CLICKED or not self.points or canvas.apart(self.points[-1], at):
            self.tap(canvas, at)
        else:
            self._create([p for n, p in enumerate(self.points) if n == 0 or p != self.points[n - 1]])

    def _create(self, points: Sequence[Point]) -> None:
        page, kind = self.page, self.kind
        made = page.edit(
            lambda: edits.create(page.workplace.text, page.scene, kind, points, page.chosen, self.file.value)
        )
        self._forget()
        if made and kind in ("mesh", "map", "arena"):
            self.palette.active = 0

    def start(self, canvas: Canvas, at: Point) -> None:
        """Begin a drag: of a handle of the chosen object, of the object at a point, of the view, or of a new object."""
        page, self.dragged = self.page, None
        if self.kind != "select":
            self.dragged = Drag("", "", at) if canvas.plane == ABOVE else None
            return
        handle = canvas.handle_at(page.scene.thing(page.chosen), at)
        if handle is not None:
            self.dragged = Drag(page.chosen, handle, at)
            return
        path = canvas.thing_at(page.scene, at)
        if path is None:
            self.dragged = Drag("", "", at)
            return
        if path != page.chosen:
            page.choose(path)
        thing = page.scene.thing(path)
        handles = thing.handles(canvas.plane) if thing is not None else {}
        if "center" in handles or len(handles) == 1:
            handle = "center" if "center" in handles else next(iter(handles))
            x, y = handles[handle]
            self.dragged = Drag(path, handle, at, (x - at[0], y - at[1]))

    def drag(self, canvas: Canvas, at: Point, by: Point) -> None:
        """Show what a drag to a point would do; by: its last step in pixels."""
        if self.dragged is None:
            return
        path, handle, start, offset = self.dragged
        if self.kind != "select":
            a, b = self._snapped(start), self._snapped(at)
            is_area = self.kind in ("box", "robot area", "arena")
            canvas.sketch([a, (b[0], a[1]), b, (a[0], b[1]), a] if is_area else [a, b])
        elif not path:
            canvas.pan(*by)
        else:
            self._preview(canvas.plane, path, handle, self._target(at, offset))

    def _target(self, at: Point, offset: Point) -> Point:
        return self._snapped((at[0] + offset[0], at[1] + offset[1]))

    def _preview(self, plane: Plane, path: str, handle: str, to: Point) -> None:
        page = self.page
        thing = page.scene.thing(path)
        if thing is None or thing.part is None:
            return
        moved = preview(page.scene, path, thing.part.moved(handle, plane, to), page.workplace.folder)
        if moved is not None and moved.part is not None:
            shown = page.scene.with_thing(moved)
            for canvas in page.canvases.values():
                canvas.show(shown, path)

    def end(self, canvas: Canvas, at: Point) -> None:
        """End a drag: edit the text."""
        page, dragged, self.dragged = self.page, self.dragged, None
        if dragged is None:
            return
        path, handle, start, offset = dragged
        if self.kind != "select":
            self._create([self._snapped(start), self._snapped(at)])
        elif path:
            target = self._target(at, offset)
            page.edit(
                lambda: edits.move_handle(page.workplace.text, page.scene, path, handle, canvas.plane, target)
            )
            page.refresh()


def _is_map(file: Path) -> bool:
    """Return whether a YAML file is a map of ROS's map_server: scenarios lie beside it."""
    try:
        return "image" in data_of(read_text(file))
    except (LineError, OSError):
        return False
