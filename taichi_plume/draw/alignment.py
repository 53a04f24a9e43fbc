"""Alignment guides (snapping): edges and middles of objects and of the room attract an object that is dragged."""

from collections.abc import Collection, Sequence

import numpy as np

from taichi_plume.draw.objects import Scene
from taichi_plume.draw.parts import Plane, Point, extent

REACH = 6.0  # pixels within which a guide attracts
PULL = 2.0  # a guide counts as this many times nearer than a line of the grid
SAME = 1e-6  # m
POINT = np.zeros((1, 2))
"""Offsets of a dragged point: the point itself."""
Line = tuple[np.ndarray, np.ndarray]
"""x and y of the ends of a shown guide [m]."""


def snapped(point: Point, step: float) -> Point:
    """Return a point moved to the nearest corner of a grid with this step [m]; 0: not moved."""
    return (round(point[0] / step) * step, round(point[1] / step) * step) if step else point


class Guides:
    """Edges and middles of the room and of the objects of a plane. dragged: paths of objects without guides."""

    def __init__(self, of: Scene, plane: Plane, dragged: Collection[str] = ()):
        still = [thing.outlines(plane) for thing in of.things if thing.path not in (*dragged, "domain")]
        room = [((0.0, 0.0), tuple(of.room[d] for d in plane))] if of.room else []
        boxes = np.array([*room, *(extent(outlines) for outlines in still if outlines)]).reshape(-1, 2, 2)
        self.features = np.stack([boxes[:, 0], boxes.mean(axis=1), boxes[:, 1]])  # (3, n, axis)

    def snapped(
        self, at: Point, step: float, reach: float, own: np.ndarray = POINT, axes: Sequence[int] = (0, 1)
    ) -> tuple[Point, list[Line]]:
        """Return a point on a guide or on the grid, and the lines of the guides that the point is on.

        step: of the grid [m], 0: the point stays; reach: of guides [m]; own: offsets from the point to the edges and
        middles of the dragged object (n, 2) [m]; axes: along which guides attract.
        """
        if not step:
            return at, []
        place = np.array(snapped(at, step))
        for axis in axes:
            targets = (self.features[:, :, axis, None] - own[:, axis]).ravel()
            gaps = np.abs(targets - at[axis])
            nearest = int(gaps.argmin()) if len(gaps) else -1
            if nearest >= 0 and gaps[nearest] <= min(reach, PULL * abs(place[axis] - at[axis])):
                place[axis] = targets[nearest]
        shown = place + own
        return (float(place[0]), float(place[1])), [
            line for axis in axes for line in self._lines(shown, axis)
        ]

    def _lines(self, shown: np.ndarray, axis: int) -> list[Line]:
        """Return the guides across an axis on which points (n, 2) lie, as long as the objects and points on them."""
        lines = []
        for value in np.unique(shown[:, axis].round(9)):
            touching = (np.abs(self.features[:, :, axis] - value) < SAME).any(axis=0)
            if touching.any():
                span = np.concatenate([self.features[:, touching, 1 - axis].ravel(), shown[:, 1 - axis]])
                ends = np.array([span.min(), span.max()])
                lines.append((np.full(2, value), ends) if axis == 0 else (ends, np.full(2, value)))
        return lines
