"""Actions of the pointer in the views: select, move, resize, draw, and move the view."""

from collections.abc import Callable, Sequence
from html import escape
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from bokeh.events import DoubleTap, Pan, PanEnd, PanStart, Tap
from bokeh.models import InlineStyleSheet, Select

from taichi_plume.draw import edits
from taichi_plume.draw.alignment import POINT, REACH, Guides, Line, snapped
from taichi_plume.draw.canvas import Canvas, View
from taichi_plume.draw.objects import preview
from taichi_plume.draw.palette import SELECT, Palette
from taichi_plume.draw.parts import Point, extent
from taichi_plume.draw.workplace import is_map
from taichi_plume.report.theme import ABOVE

if TYPE_CHECKING:
    from taichi_plume.draw.page import Page

STEPS = {"1 cm": 0.01, "5 cm": 0.05, "10 cm": 0.1, "25 cm": 0.25, "off": 0.0}
"""Steps of the grid to which the pointer snaps [m], by their labels; 0: none."""
FILES = {"mesh": (".stl", ".obj", ".ply"), "map": (".yaml", ".yml")}
"""Endings of the files of which the drawn kinds are made."""


class Drag(NamedTuple):
    """A drag that has begun. start: where the pointer went down.

    path, handle: of the dragged object; "" for the view, a new object or a rectangle that selects (`selects`).
    paths: of all objects that move with the dragged one; offset: from the start to the handle; guides: that attract the
    handle along `axes`; own: offsets from the handle to the edges and middles of the object (n, 2) [m]; view: at the
    start, of a drag that moves the view; last: where the pointer was last.
    """

    path: str
    handle: str
    start: Point
    paths: Sequence[str] = ()
    offset: Point = (0.0, 0.0)
    guides: Guides | None = None
    axes: Sequence[int] = (0, 1)
    own: np.ndarray = POINT
    view: View = ()
    last: Point | None = None
    selects: bool = False


class Pointer:
    """Pointer in the views of a page, with the palette of kinds that it draws, and the step of its grid."""

    def __init__(self, page: "Page", sheet: InlineStyleSheet):
        self.page = page
        self.dragged: Drag | None = None
        self.points: list[Point] = []
        self.step = Select(title="grid", options=list(STEPS), value="5 cm", width=80, css_classes=["alone"])
        self.file = Select(title="file", width=110, visible=False)
        self.palette = Palette(sheet, lambda _: self._tool_changed())
        for canvas in page.canvases.values():
            self._listen(canvas)

    def _listen(self, canvas: Canvas) -> None:
        """Attend to the pointer in a view; before the view joins the document: Bokeh learns of callbacks then."""

        def attend(event: Any, work: Callable[..., None]) -> None:
            def heard(e: Any) -> None:
                by = {"by": (e.delta_x, e.delta_y)} if isinstance(e, Pan) else {}
                work(canvas, (e.x, e.y), **by, **_modifiers(e))

            canvas.figure.on_event(event, heard)

        attend(Tap, self.tap)
        attend(DoubleTap, self.double_tap)
        attend(PanStart, self.start)
        attend(Pan, self.drag)
        attend(PanEnd, self.end)

    @property
    def kind(self) -> str:
        """Kind of object that the pointer draws; "select" if it selects and moves."""
        return self.palette.kind

    @property
    def usage(self) -> str:
        """Use of the pointer in the views, as HTML."""
        if self.kind != SELECT:
            return escape(edits.KINDS[self.kind])
        count = len(self.page.selection)
        if count > 1:
            return f"{count} objects are selected: drag one, or press an arrow key, and all move."
        if self.page.chosen == "domain":
            return "Drag the squares on the walls: the room becomes larger or smaller."
        return (
            "<a href='#' data-act='help'>Keys</a> · Drag an object or its handles, the squares on the walls to "
            "resize the room, the floor to move the view."
        )

    def _tool_changed(self) -> None:
        self._forget()
        endings = FILES.get(self.kind, ())
        files = sorted(
            f.name
            for f in self.page.workplace.folder.iterdir()
            if f.suffix.lower() in endings
            and not f.name.startswith(".")
            and (self.kind != "map" or is_map(f))
        )
        self.file.update(visible=bool(endings), options=files, value=files[0] if files else "")
        self.page.look()

    def _forget(self) -> None:
        """Forget what has been drawn of a new object, and the drag."""
        self.points, self.dragged = [], None
        for canvas in self.page.canvases.values():
            canvas.sketch([])
            canvas.show_aids()

    def cancel(self) -> None:
        """Give up the drag or the object that is being drawn, and the tool of the palette."""
        self._forget()
        self.palette.take(SELECT)

    @property
    def pace(self) -> float:
        """Step of the grid [m]; 0: none."""
        return STEPS[self.step.value]

    def tap(
        self, canvas: Canvas, at: Point, shift: bool = False, ctrl: bool = False, alt: bool = False
    ) -> None:
        """Select the object at a point (shift, ctrl: one more or one less), or draw there (alt: beside the grid)."""
        page = self.page
        to = at if alt else snapped(at, self.pace)
        if self.kind == SELECT:
            path = canvas.thing_at(page.scene, at) or ""
            if shift or ctrl:
                if path:
                    others = [other for other in page.selection if other != path]
                    page.select(others if path in page.selection else [*others, path])
            else:
                page.select([path or canvas.wall_at(page.scene, at)])
        elif canvas.plane != ABOVE:
            page.say("draw in the view from above; heights are set in the view from the side afterwards")
        elif self.kind in edits.CLICKED:
            self.points.append(to)
            canvas.sketch(self.points)
        else:
            self._create([to])

    def double_tap(self, canvas: Canvas, at: Point, **modifiers: bool) -> None:
        """End a polygon or a path; two quick clicks at different places are clicks (to Bokeh, a double one)."""
        if self.kind not in edits.CLICKED or not self.points or canvas.apart(self.points[-1], at):
            self.tap(canvas, at, **modifiers)
        else:
            self._create([p for n, p in enumerate(self.points) if n == 0 or p != self.points[n - 1]])

    def _create(self, points: Sequence[Point]) -> None:
        page, kind = self.page, self.kind
        made = page.edit(
            lambda: edits.create(page.workplace.text, page.scene, kind, points, page.chosen, self.file.value)
        )
        self._forget()
        if made and kind in ("mesh", "map", "arena"):
            self.palette.take(SELECT)

    def start(
        self, canvas: Canvas, at: Point, shift: bool = False, ctrl: bool = False, alt: bool = False
    ) -> None:
        """Begin a drag: of a handle, of the object at a point with all selected ones, of the view, or of a new object.

        shift: of a rectangle that selects what lies within.
        """
        page, self.dragged = self.page, None
        scene, plane = page.scene, canvas.plane
        if self.kind != SELECT:
            if plane == ABOVE:
                guides = Guides(scene, plane)
                a = at if alt else guides.snapped(at, self.pace, REACH * canvas.pixel())[0]
                self.dragged = Drag("", "", a, guides=guides)
            return
        if shift or ctrl:
            self.dragged = Drag("", "", at, selects=True)
            return
        found = canvas.handle_at(scene, page.selection, at)
        if found is not None:
            path, handle = found
            axes = [n for n in (0, 1) if handle[0] not in "+-" or int(handle[2 * n : 2 * n + 2])]
            guides = None if handle in ("rim", "turn") else Guides(scene, plane, [path])
            self.dragged = Drag(path, handle, at, [path], guides=guides, axes=axes)
            if path != page.chosen:
                page.select([path])
            return
        path = canvas.thing_at(scene, at)
        if path is None:
            self.dragged = Drag("", "", at, view=canvas.view)
            return
        if path not in page.selection:
            page.select([path])
        thing = scene.thing(path)
        handle = thing.grip(plane) if thing is not None else None
        if thing is not None and handle is not None:
            x, y = thing.handles(plane)[handle]
            low, high = extent(thing.outlines(plane)) - (x, y)
            self.dragged = Drag(
                path, handle, at, page.selection, (x - at[0], y - at[1]), Guides(scene, plane, page.selection),
                own=np.array([low, (low + high) / 2, high]),
            )  # fmt: skip

    def drag(self, canvas: Canvas, at: Point, by: Point, alt: bool = False, **_: bool) -> None:
        """Show what a drag to a point would do. by: pixels from its start; alt: neither grid nor guides attract."""
        if self.dragged is None:
            return
        self.dragged = self.dragged._replace(last=at)
        path, a = self.dragged.path, self.dragged.start
        if self.dragged.selects:
            canvas.sketch([a, (at[0], a[1]), at, (a[0], at[1]), a])
        elif self.kind != SELECT:
            b, lines = self._target(canvas, at, alt)
            line, text = edits.sketch(self.kind, a, b, self.page.scene.room)
            canvas.sketch(line)
            canvas.show_aids(at, text, lines)
        elif not path:
            canvas.pan(self.dragged.view, *by)
        else:
            self._preview(canvas, at, alt)

    def _target(self, canvas: Canvas, at: Point, alt: bool) -> tuple[Point, list[Line]]:
        """Return where a drag to a point takes its handle, and the guides on which the handle is then."""
        assert self.dragged is not None
        to = at[0] + self.dragged.offset[0], at[1] + self.dragged.offset[1]
        guides, step, reach = self.dragged.guides, 0.0 if alt else self.pace, REACH * canvas.pixel()
        if self.dragged.handle == "turn":
            return to, []
        if guides is None:
            return snapped(to, step), []
        return guides.snapped(to, step, reach, self.dragged.own, self.dragged.axes)

    def _moves(self, canvas: Canvas, to: Point) -> list[tuple[str, str, Point]]:
        """Return (path, handle, position) of all handles that a drag moves."""
        assert self.dragged is not None
        path, handle, paths, scene = (
            self.dragged.path,
            self.dragged.handle,
            self.dragged.paths,
            self.page.scene,
        )
        thing = scene.thing(path)
        if thing is None or len(paths) == 1:
            return [(path, handle, to)]
        x, y = thing.handles(canvas.plane)[handle]
        return edits.moves(scene, paths, canvas.plane, (to[0] - x, to[1] - y))

    def _preview(self, canvas: Canvas, at: Point, alt: bool) -> None:
        page, shown = self.page, self.page.scene
        assert self.dragged is not None
        to, lines = self._target(canvas, at, alt)
        for path, handle, place in self._moves(canvas, to):
            thing = page.scene.thing(path)
            if thing is None or thing.part is None:
                continue
            values = thing.part.moved(handle, canvas.plane, place)
            moved = preview(page.scene, path, values, page.workplace.folder)
            if moved is not None and moved.part is not None:
                shown = shown.with_thing(moved)
        for other in page.canvases.values():
            other.show(shown, page.selection)
        dragged = shown.thing(self.dragged.path)
        if dragged is not None and dragged.part is not None:
            canvas.show_aids(at, dragged.part.measure(self.dragged.handle, canvas.plane), lines)

    def end(self, canvas: Canvas, at: Point, alt: bool = False, **_: bool) -> None:
        """End a drag: edit the text, or select what lies within a rectangle."""
        page, dragged = self.page, self.dragged
        if dragged is None:
            return
        at = dragged.last or at  # a browser that breaks off the drag of a finger gives a position of its own
        to = self._target(canvas, at, alt)[0]
        moves = self._moves(canvas, to) if dragged.path else []
        self._forget()
        if dragged.selects:
            page.select([*page.selection, *canvas.things_within(page.scene, dragged.start, at)])
        elif self.kind != SELECT:
            self._create([dragged.start, to])
        elif moves:
            page.edit(lambda: edits.move(page.workplace.text, page.scene, moves, canvas.plane))
            page.refresh()


def _modifiers(event: Any) -> dict[str, bool]:
    """Return which modifier keys were held during an event."""
    return {key: bool((event.modifiers or {}).get(key)) for key in ("shift", "ctrl", "alt")}
