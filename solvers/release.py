"""Release from balls (in 2-D discs) on the grid: vapour sources and heaters of finite size.

A small ball, anywhere in a cell, is released by a kernel (see `shares`) of one to two cells. A ball of radius R has the
variance R²/(dim + 2) along an axis. If this exceeds the kernel's variance, each cell releases its part of the ball. The
ball is narrowed along each axis by the variance that means over cells and interpolation add, so that the plume of a
large source or steady heater has the right width. The kernel also spreads the ball of a heater that releases puffs, and
a ball whose centre lies in an obstacle, as its release has to reach the air around. The release stays in the air
connected to the ball's own cells: behind a thin wall nothing appears.
"""

from collections.abc import Sequence
from contextlib import suppress
from functools import partial
from math import ceil, prod

import numpy as np

from taichi_plume.engine import ti
from taichi_plume.engine.fields import Field
from taichi_plume.grid.cut_cells import Air
from taichi_plume.grid.grid import Grid, block_mean
from taichi_plume.grid.kernels import Pass, Template
from taichi_plume.scenario.heat import Heater
from taichi_plume.scenario.sources import Source
from taichi_plume.solvers.surface_exchange import FIRST

VARIANCE = 5.0 / 6.0
"""Sum of two variances [cells²]: that of the shares of a point and that of the linear interpolation of readings."""
REACH = 2
"""Number of cells on either side that a point release reaches, from the cell at or before the point; one more above."""
LATTICE = 4
"""Positions per cell and axis at which a ball on a path counts; the error is far below the width of the kernel."""
SMOOTHED = 1.0 / 6.0
"""Weight of smoothing to either side. Measured: with less weno5, with more koren lags in a wind oblique to the grid."""


def shares(f: float) -> np.ndarray:
    """Return the shares w, (2 REACH + 2,), of cells -REACH to REACH + 1 in the release at a point.

    f [cells]: position of the point in [0, 1) from the centre of cell 0 to that of cell 1 (beyond 1/2, mirrored).
    Linear interpolation, by which gas sensors read, spreads a value at f with the variance f (1 - f) [cells²]; w has
    the rest of 5/6. Readings on the axis of a plume thus do not depend on the position of the source in a cell, at any
    distance (within 3 %; the usual shares of the two nearest cells give 4 times as much at a cell's centre as at its
    corner). No share is negative, and their centroid is f. As in Peskin's conditions for immersed boundaries (2002,
    doi:10.1017/S0962492902000077), moments determine the shares: four cells whose centroid is f, whose variance is 1/2
    - f (1 - f), and whose interpolate at f is 1/2. They are smoothed by SMOOTHED on either side. A negative share in
    the last cell is then balanced from its neighbours by a third difference, which leaves the sum, the centroid and the
    variance.
    """
    if f > 0.5:
        return shares(1.0 - f)[::-1]
    before, beyond = (1.0 - f) * (1.0 - 2.0 * f) / 4.0, -f * (1.0 - 2.0 * f) / 4.0
    second = f + before - 2.0 * beyond
    four = np.array([0.0, before, 1.0 - before - second - beyond, second, beyond, 0.0])
    w = np.convolve(four, [SMOOTHED, 1.0 - 2.0 * SMOOTHED, SMOOTHED], "same")
    return w - w[-1] * np.array([0.0, 0.0, -1.0, 3.0, -3.0, 1.0])


def spread(values: np.ndarray, f: np.ndarray) -> np.ndarray:
    """Return an array whose values are spread by `shares` of f (dim,): REACH cells more before, REACH + 1 after."""
    for axis, place in enumerate(f):
        along = np.moveaxis(values, axis, 0)
        wider = np.zeros((len(along) + 2 * REACH + 1, *along.shape[1:]))
        for n, share in enumerate(shares(float(place))):
            wider[n : n + len(along)] += share * along
        values = np.moveaxis(wider, 0, axis)
    return values


def tilted(weights: np.ndarray, points: np.ndarray, centroid: np.ndarray) -> np.ndarray:
    """Return weights (n,) of points (n, dim) with this centroid and the least relative entropy to the given weights.

    If the points do not surround the centroid, the result comes near it. All lengths are in cells. The dual problem is
    convex with dim unknowns, solved by Newton's method: scipy.optimize takes half a second to import.
    """
    away = points - centroid
    near = 1e-3  # regularisation that keeps the tilt finite
    tilt = np.zeros(points.shape[1])

    def dual(tilt: np.ndarray) -> tuple[float, np.ndarray]:
        exponent = away @ tilt
        w = weights * np.exp(exponent - exponent.max())
        return exponent.max() + np.log(w.sum()) + 0.5 * near * float(tilt @ tilt), w / w.sum()

    value, w = dual(tilt)
    for _ in range(100):
        mean = w @ away
        slope = mean + near * tilt
        curvature = (w[:, None] * away).T @ away - np.outer(mean, mean) + near * np.eye(len(tilt))
        step = -np.linalg.solve(curvature, slope)
        if -(slope @ step) < 1e-14:
            break
        length = 1.0
        while (new := dual(tilt + length * step))[0] > value + 1e-4 * length * float(slope @ step):
            length *= 0.5
            if length < 1e-6:
                return w
        tilt, (value, w) = tilt + length * step, new
    return w


CELL = 1.0 / 12.0  # variance along an axis that a mean over a cell adds [cells²]
SAMPLES = 4  # samples per axis, to measure a ball's fraction of a cell


class Release:
    """Release of vapour or heat from balls into cells. `set_amounts` sets the next release, `into` returns its pass.

    balls: cells (n, dim) of each ball and the share of the release (n,) per cell.
    """

    def __init__(
        self,
        name: str,
        balls: Sequence[Source | Heater],
        grid: Grid,
        air: Air,
        room: np.ndarray,
        blurred: bool = False,
    ):
        """name: of the balls in messages; room: air fraction of each cell (grid.shape). blurred: whether the kernel
        spreads balls of any radius, which lets the puffs of heaters (see `heat`) stir a cell's width around their ball.
        Raises ValueError for a ball that covers no air.
        """
        self.grid, self.room = grid, room
        self._area = air.area
        self._amounts: list[float] = []
        self._moving = {
            n: ball for n, ball in enumerate(balls) if isinstance(ball, Source) and ball.motion is not None
        }
        for n, ball in self._moving.items():
            ball.require_air(f"{name}[{n}]", grid.dx / (4 * LATTICE), self._is_air)
        self.balls = [
            self._cells_of(f"{name}[{n}]", ball.radius, np.array(ball.position), blurred)
            for n, ball in enumerate(balls)
        ]
        self._at: dict[int, np.ndarray] = {}
        for n, ball in self._moving.items():
            self.balls[n] = self._padded(ball.radius, *self.balls[n])
        self.cells = sum(len(where) for where, _ in self.balls)
        where = np.concatenate([np.empty((0, grid.dim), int), *(where for where, _ in self.balls)])
        self._cell = ti.filled_vectors(where + grid.ghost)
        self._owner = ti.filled(np.repeat(np.arange(len(balls)), [len(where) for where, _ in self.balls]))
        self._share = ti.field(ti.f64, self.cells)  # amount per volume of air
        self._amount = ti.field(ti.f64, len(balls))
        self.set_shares([part for _, part in self.balls])

    def set_shares(self, shares: Sequence[np.ndarray]) -> None:
        """Set the shares of each ball's release that its cells, in the order of `balls`, receive from now on."""
        densities, first = np.zeros(self._share.shape), 0
        for (where, _), share in zip(self.balls, shares, strict=True):
            room = self.room[tuple(where.T)] * self.grid.cell_volume
            densities[first : first + len(where)] = share / room
            first += len(where)
        self._share.from_numpy(densities)

    def follow(self, t: float) -> bool:
        """Move the shares of balls on a path to their positions at time t [s]; return whether any ball has moved.

        A position counts to a fraction 1/LATTICE of a cell: the shares are computed only as often as a ball has moved
        by that, and depend on the time alone, as a resumed run needs.
        """
        moved = []
        for n, ball in self._moving.items():
            place = self._on_lattice(ball.places(t))
            if n not in self._at or not np.array_equal(place, self._at[n]):
                with suppress(ValueError):  # grazes an obstacle between two samples of the path
                    cells = self._cells_of("", ball.radius, place, False)
                    self.balls[n] = self._padded(ball.radius, *cells)
                self._at[n] = place
                moved.append(n)
        if moved:
            where = np.concatenate([where for where, _ in self.balls])
            self._cell.from_numpy((where + self.grid.ghost).astype(np.int32))
            self.set_shares([part for _, part in self.balls])
        return bool(moved)

    def _on_lattice(self, places: np.ndarray) -> np.ndarray:
        """Return positions (..., dim) [m] rounded to a fraction 1/LATTICE of a cell."""
        step = self.grid.dx / LATTICE
        return np.clip(np.round(places / step) * step, 0.0, self.grid.extent)

    def _is_air(self, places: np.ndarray) -> np.ndarray:
        """Return a mask of the positions (n, dim) [m] whose cell holds air, once on the lattice."""
        cells = np.round(self._on_lattice(places) / self.grid.dx - 0.5).astype(int)
        return self.room[tuple(np.clip(cells, 0, np.array(self.grid.shape) - 1).T)] > 0.0

    def _padded(self, radius: float, where: np.ndarray, share: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return cells (m, dim) and shares (m,) of a ball with as many cells as it covers at any position."""
        widest = 2 * self._half(radius) + 2 * REACH + 2
        spare = prod(min(widest, n) for n in self.grid.shape) - len(share)
        return np.concatenate([where, np.repeat(where[:1], spare, 0)]), np.append(share, np.zeros(spare))

    def _half(self, radius: float) -> int:
        """Return how many cells a ball around a cell's centre touches on either side along an axis."""
        return max(0, ceil(radius / self.grid.dx - 0.5))

    def _cells_of(
        self, path: str, radius: float, place: np.ndarray, blurred: bool
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the cells (n, dim) of a ball at `place` (dim,) [m] and their shares (n,) of the release. Raises
        ValueError without air.
        """
        half, radius = self._half(radius), radius / self.grid.dx  # here lengths are in cells
        place = place / self.grid.dx - 0.5  # from the centre of the first cell
        base = np.floor(place).astype(int)
        f = place - base
        nearest = np.clip(np.round(place).astype(int), 0, np.array(self.grid.shape) - 1)
        in_air = self.room[tuple(nearest)] > 0.0
        # cells of a ball around the base cell, as far as they can touch the domain
        first = [max(-half, -b - REACH - 1) for b in base]
        last = [min(half, n - b + REACH - 1) for b, n in zip(base, self.grid.shape, strict=True)]
        blocks = [np.arange(a, b + 1) for a, b in zip(first, last, strict=True)]
        if in_air and not blurred and radius**2 > (self.grid.dim + 2) * VARIANCE:
            narrower = np.sqrt(radius**2 - (self.grid.dim + 2) * (CELL + f * (1.0 - f)))
            share = _even_ball(narrower, [np.arange(n[0] - REACH, n[-1] + REACH + 2) for n in blocks], f)
        else:
            within = np.full(place.shape, 0.0 if in_air and not blurred else radius)
            share = spread(_even_ball(within, blocks, np.zeros(place.shape)), f)
        every, axes = np.count_nonzero(share), []
        for axis, n in enumerate(self.grid.shape):
            at = base[axis] + first[axis] - REACH + np.arange(share.shape[axis])
            inside = (at >= 0) & (at < n) | self.grid.periodic[axis]
            share = np.compress(inside, share, axis)
            axes.append(at[inside])
        points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1) - place
        cells = np.ix_(*(at % n for at, n in zip(axes, self.grid.shape, strict=True)))
        room = self.room[cells]
        home = np.unravel_index(np.abs(points).max(axis=-1).argmin(), room.shape)
        start = np.zeros(room.shape, bool)
        start[home] = True
        if room[home] == 0.0:  # an obstacle may hold the centre and emit around itself
            start = np.linalg.norm(np.maximum(np.abs(points) - 0.5, 0.0), axis=-1) < radius
        start &= (room > 0.0) & (share > 0.0)
        if not start.any():
            raise ValueError(
                f"{path}.position: is not in the air: an obstacle fills its cell or seals it off; "
                "move it by a cell or lower domain.spacing"
            )
        leads = [area[cells] > 0.0 for area in self._area]
        reached = _reached(start, leads, share > 0.0)
        whole = np.count_nonzero(share * reached * (room == 1.0)) == every
        share = share * room * reached
        where = np.argwhere(share > 0)
        covered = tuple(where.T)
        share = share[covered] / share.sum()
        middle = np.zeros(place.shape) if whole else _middle(radius, points, room * reached)
        share = tilted(share, points[covered], middle)
        return np.stack([at[where[:, d]] for d, at in enumerate(axes)], axis=-1) % self.grid.shape, share

    def set_amounts(self, amounts: list[float]) -> None:
        """Set the amount (kg or J per heat capacity) that each ball releases in the next step."""
        if amounts != self._amounts:
            self._amounts = amounts
            self._amount.from_numpy(amounts)

    def into(self, q: Field, rest: Field, start: Field) -> Pass:
        """Return the pass that adds the release to a scalar (amount per volume) in the first stage of a step.

        rest: rounding errors of q; start: q at the start of the step, sources included.
        """
        return Pass(partial(self._add_to, q, rest, start), self.cells)

    def filling(self, source: Field, room: Field) -> Pass:
        """Return the pass that sets the volume that the present amounts release in each cell [1/s], with a volume per
        amount and time `a`; room: air fraction of each cell, None if no cell is cut.
        """
        return Pass(partial(self._fill, source, room is not None, room), self.cells)

    @ti.func
    def _fill(self, source: Template, cut: Template, room: Template, a, b):
        for _ in range(1):  # balls may share cells
            for n in range(self.cells):
                source[self._cell[n]] = 0.0
            for n in range(self.cells):
                I = self._cell[n]
                volume = ti.cast(self._amount[self._owner[n]] * self._share[n] * a, ti.f32)
                if ti.static(cut):
                    volume *= room[I]
                source[I] += volume

    @ti.func
    def _add_to(self, q: Template, rest: Template, start: Template, h, stage):
        if stage == FIRST:
            for n in range(self.cells):  # one after the other, as balls may share cells
                I = self._cell[n]
                held = ti.cast(q[I], ti.f64) + ti.cast(rest[I], ti.f64)
                held += self._amount[self._owner[n]] * self._share[n]
                q[I] = start[I] = ti.cast(held, ti.f32)
                rest[I] = ti.cast(held - ti.cast(ti.cast(held, ti.f32), ti.f64), ti.f32)


def _even_ball(radii: np.ndarray, cells: Sequence[np.ndarray], middle: np.ndarray) -> np.ndarray:
    """Return the fraction of an ellipsoid around `middle` in each cell of a block; cells: consecutive indices per axis.

    All lengths are in cells.
    """
    sub = (np.arange(SAMPLES) + 0.5) / SAMPLES - 0.5
    away = [(axis[:, None] + sub - x).ravel() for axis, x in zip(cells, middle, strict=True)]
    squares = [(x / max(radius, 1e-9)) ** 2 for x, radius in zip(away, radii, strict=True)]
    share = block_mean(sum(np.ix_(*squares), start=np.zeros(())) <= 1.0, SAMPLES)
    if not share.any():  # smaller than the sample spacing
        share[tuple(round(x) - axis[0] for axis, x in zip(cells, middle, strict=True))] = 1.0
    return share / share.sum()


def _reached(start: np.ndarray, leads: Sequence[np.ndarray], within: np.ndarray) -> np.ndarray:
    """Return a mask of the cells of a block that are connected to the cells `start` through cells `within` and open
    faces; leads: per axis whether each lower face is open.
    """
    reached, before = start.copy(), 0
    while (count := np.count_nonzero(reached)) > before:
        before = count
        for axis, open_faces in enumerate(leads):
            cells, faces, allowed = (np.moveaxis(array, axis, 0) for array in (reached, open_faces, within))
            for n in range(1, len(cells)):
                cells[n] |= cells[n - 1] & faces[n] & allowed[n]
            for n in range(len(cells) - 1, 0, -1):
                cells[n - 1] |= cells[n] & faces[n] & allowed[n - 1]
    return reached


def _middle(radius: float, points: np.ndarray, room: np.ndarray) -> np.ndarray:
    """Return the centroid of a ball around 0, weighted by the air fraction `room` of cells at `points` [cells]."""
    axis = radius * (np.arange(2 * SAMPLES) + 0.5 - SAMPLES) / SAMPLES
    inner = np.stack(np.meshgrid(*[axis] * points.shape[-1], indexing="ij"), axis=-1)
    inner = inner[np.linalg.norm(inner, axis=-1) <= radius]
    first = points[(0,) * (points.ndim - 1)]
    cell = np.round(inner - first).astype(int)
    within = np.all((cell >= 0) & (cell < room.shape), axis=-1)
    stores = np.where(within, room[tuple(np.where(within[:, None], cell, 0).T)], 0.0)
    if not stores.any():
        return np.average(points.reshape(-1, points.shape[-1]), axis=0, weights=room.ravel())
    return np.average(inner, axis=0, weights=stores)
