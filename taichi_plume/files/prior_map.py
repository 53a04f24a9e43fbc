"""Prior of the source's position: weights over the floor from a picture, an array or areas, as means over cells.

The weight of a cell is the mean weight per area over the cell. It is exact for pixels, which are rectangles, and taken
from a grid of points in each cell for areas, which are polygons. What lies beyond the pixels weighs nothing.
"""

from pathlib import Path

import numpy as np

from taichi_plume.files.numpy_files import SUFFIXES, read_arrays
from taichi_plume.grid.map_files import PICTURES, MapError, read_picture
from taichi_plume.guard.input_error import InputError
from taichi_plume.guard.terminal import visible
from taichi_plume.scenario.domain import Arena, span
from taichi_plume.scenario.prior import Prior

FINE, MOST_POINTS = 8, 4_000_000  # points per cell edge for areas; points in all cells
SLIVER = 1e-9  # of a cell's edge: smaller overlaps come from rounding
TESTED = (64, 64)  # cells in which a prior is looked for on the floor
NAME = "prior"  # of the array in a .npz file


class PriorError(InputError):
    """Error of a prior. key: key of the section that is wrong, "" for all of them."""

    def __init__(self, key: str, what: str):
        super().__init__(what)
        self.key = key


class PriorMap:
    """Weights of a prior over the floor. folder: of its file. Raises PriorError if no weight on the floor is positive.

    values: weights (x, y) of pixels, with edges of `step` (2,) [m] from corner `low` (2,) [m] on; None for areas.
    """

    def __init__(self, model: Prior, floor: Arena, folder: Path):
        self.model = model
        self.values = None if model.areas else _values(model, folder)
        size = np.array(floor.size)
        if self.values is not None:
            self.low = np.array(model.origin or floor.low, float)
            self.step = np.full(2, model.resolution) if model.resolution else size / self.values.shape
        room = f"the robots' floor is {span('x', floor.low[0], floor.high[0])}, "
        room += span("y", floor.low[1], floor.high[1])
        for n, area in enumerate(model.areas or ()):
            low, high = np.min(area.vertices, axis=0), np.max(area.vertices, axis=0)
            if (low >= floor.high).any() or (high <= floor.low).any():
                spans = f"{span('x', low[0], high[0])}, {span('y', low[1], high[1])}"
                raise PriorError(f"areas[{n}].vertices", f"lies outside of the room: {spans}; {room}")
        if not self.on(floor.low, size / TESTED, TESTED).any():
            key = "file" if model.file else "values" if model.values else "areas"
            if self.values is None or not self.values.any():
                raise PriorError(key, "is zero everywhere; give a positive weight to some place on the floor")
            ends = self.low + self.step * self.values.shape
            spans = f"{span('x', self.low[0], ends[0])}, {span('y', self.low[1], ends[1])}"
            raise PriorError(key, f"is zero everywhere in the room: its pixels span {spans}; {room}")

    def on(self, low: object, edge: object, cells: tuple[int, int]) -> np.ndarray:
        """Return mean weights (nx, ny) of cells with this lower corner (2,) and edge, one or (2,) [m]."""
        lines = [
            start + width * np.arange(count + 1)
            for start, width, count in zip(np.asarray(low), np.broadcast_to(edge, 2), cells, strict=True)  # type: ignore
        ]
        if self.values is None:
            return self._in_areas(lines, cells)
        along = [
            _overlap(line, start + width * np.arange(count + 1))
            for line, start, width, count in zip(lines, self.low, self.step, self.values.shape, strict=True)
        ]
        area = (lines[0][1] - lines[0][0]) * (lines[1][1] - lines[1][0])
        return np.asarray((along[1] @ (along[0] @ self.values).T).T) / area

    def _in_areas(self, lines: list[np.ndarray], cells: tuple[int, int]) -> np.ndarray:
        """Return mean weights (nx, ny) of cells between these lines, from points in each cell."""
        fine = int(np.clip((MOST_POINTS / (cells[0] * cells[1])) ** 0.5, 1, FINE))
        x, y = (
            (line[:-1, None] + np.diff(line)[:, None] * (np.arange(fine) + 0.5) / fine).ravel()
            for line in lines
        )
        weight = np.full((len(x), len(y)), self.model.rest)
        for area in self.model.areas or ():
            weight[_within(x[:, None], y, np.array(area.vertices))] = area.weight
        return weight.reshape(cells[0], fine, cells[1], fine).mean(axis=(1, 3))


def _values(model: Prior, folder: Path) -> np.ndarray:
    """Return the weights (x, y) of a file or of `values`. Raises PriorError."""
    if model.file is None:
        return np.array(model.values, float).T
    path = folder / model.file

    def fault(what: str) -> PriorError:
        return PriorError("file", what)

    suffix = path.suffix.lower()
    if suffix in PICTURES:
        try:
            levels, most, opaque = read_picture(path, path)
        except MapError as error:
            raise fault(str(error)) from None
        return (levels / most * (1.0 if opaque is None else opaque))[::-1].T
    if suffix not in SUFFIXES:
        allowed = ", ".join((*PICTURES, *SUFFIXES))
        raise fault(f"{path}: has the ending '{visible(suffix, 20)}'; allowed are {allowed}")
    arrays = read_arrays(path, fault)
    name = NAME if NAME in arrays else next(iter(arrays), "")
    if name not in arrays or (name != NAME and len(arrays) > 1):
        raise fault(
            f"{path}: holds {visible(', '.join(arrays) or 'nothing', 100)}; wanted one array, '{NAME}'"
        )
    values = arrays[name]
    if values.ndim != 2 or values.size == 0 or values.dtype.kind not in "buif":
        raise fault(f"{path}: is {values.dtype} of shape {values.shape}; wanted numbers with axes (y, x)")
    values = values.astype(float)
    bad = np.argwhere(~(np.isfinite(values) & (values >= 0.0)))
    if len(bad):
        row, column = bad[0].tolist()
        raise fault(
            f"{path}: weight [{row}, {column}] is {values[row, column]:g}; allowed are finite ones from 0 on"
        )
    return values.T / max(float(values.max()), 1e-300)


def _overlap(cells: np.ndarray, pixels: np.ndarray):
    """Return the lengths (n, m) [m] that n cells share with m pixels, a sparse array; both given by rising edges."""
    from scipy.sparse import csr_array

    cuts = np.unique(np.concatenate([cells, pixels]))
    middle, width = 0.5 * (cuts[1:] + cuts[:-1]), np.diff(cuts)
    row, column = np.searchsorted(cells, middle) - 1, np.searchsorted(pixels, middle) - 1
    shape = len(cells) - 1, len(pixels) - 1
    shared = (row >= 0) & (row < shape[0]) & (column >= 0) & (column < shape[1])
    shared &= width > SLIVER * (cells[1] - cells[0])
    return csr_array((width[shared], (row[shared], column[shared])), shape=shape)


def _within(x: np.ndarray, y: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Return whether points lie in a polygon, corners (n, 2): a ray from inside crosses it an odd number of times."""
    odd = np.zeros(np.broadcast_shapes(x.shape, y.shape), bool)
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        if a[1] != b[1]:
            odd ^= ((a[1] > y) != (b[1] > y)) & (x < a[0] + (y - a[1]) * (b[0] - a[0]) / (b[1] - a[1]))
    return odd
