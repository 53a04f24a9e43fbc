"""Steady advection-diffusion of a gas on a mean wind, and its adjoint, for the likelihoods of beliefs.

The concentration c [kg/m³] of sources S [kg/(s m³)] in a wind u with eddy diffusivity K and lifetime T obeys

    div(u c - K grad c) + c / T = S,        n · (u c - K grad c) = 0 on walls

in finite volumes on square or cubic cells: A c = q, q the rate of each cell [kg/s]. The flux through a face between
cells i and j, of area F at a distance h, is F (u (c_i + c_j) / 2 - max(K, |u| h / 2) (c_j - c_i) / h): central
differences up to a cell Péclet number of 2, upwind differences above (hybrid scheme, Spalding 1972,
doi:10.1002/nme.1620040409). Air that enters through an open edge is clean; it leaves with the concentration of the
last cell. A is an M-matrix, hence c >= 0.

The adjoint a = A⁻ᵀ w of a sensor that weighs cells by w has in each cell the reading of a source of unit rate there
(Marchuk 1995, Adjoint Equations and Analysis of Complex Systems; Pudykiewicz 1998,
doi:10.1016/S1352-2310(97)00480-9): w · c = a · q, the reciprocity of source and receptor. It is also the gradient in
the rates of any function whose derivative with respect to the concentrations is w.

The wind is made mass-consistent first: the least change of the velocities on faces, in the sense of squares, that makes
their divergence zero (Sasaki 1970; Sherman 1978, doi:10.1175/1520-0450(1978)017<0312:AMCMFW>2.0.CO;2). Walls and
closed edges stay without flow. Open edges are those that the wind crosses, unless given.
"""

from collections.abc import Callable, Sequence
from copy import copy
from functools import cached_property
from typing import cast

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import LinearOperator, SuperLU, gmres, spilu, splu

MOST_DIRECT = 40_000  # cells in 3-D for a direct factorisation, which fills; in 2-D ten times as many
TOLERANCE = 1e-10  # relative residual of iterations
MOST_CELLS = 2_000_000


class Dispersion:
    """Steady dispersion on a mean wind. Cells are numbered as in `wind`, the last axis fastest.

    wind: velocity at the centres of the cells (nx, ny, 2) or (nx, ny, nz, 3) [m/s]. cell: edge of the cells [m]. solid:
    mask of cells without air, (nx, ny) or (nx, ny, nz). diffusivity: eddy diffusivity K [m²/s]. lifetime: T [s] after
    which gas is lost, or for which it has been released; None: for ever. depth: of a layer in 2-D [m]. open_edges:
    whether air may cross the edges of the domain, or masks of the cells along each edge, x-, x+, y-, y+ and so on.
    Raises ValueError for other shapes or values, and if neither an open edge nor a lifetime removes the gas.
    """

    def __init__(
        self,
        wind: np.ndarray,
        cell: float,
        solid: np.ndarray | None = None,
        *,
        diffusivity: float = 0.01,
        lifetime: float | None = None,
        depth: float = 1.0,
        open_edges: bool | Sequence[np.ndarray] = True,
    ):
        wind = np.asarray(wind, float)
        self.shape, self.dim, self.cell = wind.shape[:-1], wind.ndim - 1, float(cell)
        if self.dim not in (2, 3) or wind.shape[-1] != self.dim or not wind.size:
            raise ValueError(f"wind: got the shape {wind.shape}; allowed are (nx, ny, 2) and (nx, ny, nz, 3)")
        self.solid = np.zeros(self.shape, bool) if solid is None else np.asarray(solid, bool)
        if self.solid.shape != self.shape:
            raise ValueError(f"solid: got the shape {self.solid.shape}; the wind has {self.shape}")
        if not np.isfinite(wind[~self.solid]).all():
            raise ValueError("wind: a cell with air is not finite")
        if self.solid.size > MOST_CELLS:
            raise ValueError(f"wind: {self.solid.size} cells; at most {MOST_CELLS} are allowed")
        for name, value in (("cell", cell), ("diffusivity", diffusivity), ("depth", depth)):
            if not 0.0 < value < np.inf:
                raise ValueError(f"{name}: got {value:g}; must be above 0")
        if lifetime is not None and not lifetime > 0.0:
            raise ValueError(f"lifetime: got {lifetime:g} s; must be above 0")
        self.diffusivity = float(diffusivity)
        self.loss = 0.0 if lifetime is None else 1.0 / lifetime
        self.area = cell ** (self.dim - 1) * (depth if self.dim == 2 else 1.0)  # of a face [m²]
        self.volume = self.area * cell  # of a cell [m³]
        self.number = np.arange(self.solid.size).reshape(self.shape)
        self.faces = [self._faces(wind, axis) for axis in range(self.dim)]
        edge, outflow, self.outward = self._edges(wind, open_edges)
        self.edges = edge, outflow
        self._make_consistent()

    def with_diffusivity(self, diffusivity: float) -> "Dispersion":
        """Return the dispersion on the same mass-consistent wind with another eddy diffusivity [m²/s]."""
        other = copy(self)
        other.diffusivity = float(diffusivity)
        for name in ("matrix", "_solve"):
            vars(other).pop(name, None)
        return other

    def concentration(self, rates: np.ndarray) -> np.ndarray:
        """Return the concentration [kg/m³] of sources with these rates in the cells [kg/s], both (..., *shape).

        Rates in solid cells have no effect.
        """
        return self._solved(rates, "N")

    def adjoint(self, weights: np.ndarray) -> np.ndarray:
        """Return for each cell the weighted sum of concentrations per rate of a source there, (..., *shape) [s/m³].

        weights: of each cell's concentration in the sum, (..., *shape); 1 in the cell of a sensor, 0 elsewhere. The
        result is the gradient of the sum in the rates of the sources.
        """
        return self._solved(weights, "T")

    def at(self, place: Sequence[float], low: Sequence[float] | None = None) -> np.ndarray:
        """Return weights (*shape) that interpolate linearly at a point [m] among the centres of cells with air.

        low: lower corner of the cells [m], by default the origin. Raises ValueError for a point outside of the cells or
        without air around it.
        """
        corner = np.zeros(self.dim) if low is None else np.asarray(low, float)
        x = (np.asarray(place, float) - corner) / self.cell
        if x.shape != (self.dim,) or not ((x >= -1e-9) & (x <= np.array(self.shape) + 1e-9)).all():
            raise ValueError(f"place: got {list(place)}; must lie within the cells")
        x = np.clip(x - 0.5, 0.0, np.array(self.shape) - 1.0)
        first = np.minimum(x.astype(int), np.maximum(np.array(self.shape) - 2, 0))
        weights = np.zeros(self.shape)
        for corner_ in np.ndindex(*(2,) * self.dim):
            at = tuple(np.minimum(first + corner_, np.array(self.shape) - 1))
            share = np.prod(np.where(np.array(corner_) == 1, x - first, 1.0 - (x - first)))
            weights[at] += 0.0 if self.solid[at] else share
        if weights.sum() <= 1e-9:
            raise ValueError(f"place: no air at {list(place)}")
        return weights / weights.sum()

    # ------------------------------------------------------------ wind on faces

    def _faces(self, wind: np.ndarray, axis: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return lower and upper cell of the faces between cells with air along an axis, and the velocity there."""
        lower, upper = (
            tuple(part if d == axis else slice(None) for d in range(self.dim))
            for part in (slice(None, -1), slice(1, None))
        )
        free = ~(self.solid[lower] | self.solid[upper])
        speed = 0.5 * (wind[lower][..., axis] + wind[upper][..., axis])
        return self.number[lower][free], self.number[upper][free], speed[free]

    def _edges(
        self, wind: np.ndarray, open_edges: bool | Sequence[np.ndarray]
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return cell, outflow [m/s] and outward direction (dim,) of the faces on the edge that the wind crosses."""
        cells, speeds, directions = [], [], []
        for axis in range(self.dim):
            for end, sign in ((0, -1.0), (-1, 1.0)):
                side = open_edges if isinstance(open_edges, bool) else open_edges[2 * axis - end]
                free = ~np.take(self.solid, end, axis) & side
                cells.append(np.take(self.number, end, axis)[free])
                speeds.append(sign * np.take(wind[..., axis], end, axis)[free])
                directions.append(np.tile(sign * np.eye(self.dim)[axis], (len(cells[-1]), 1)))
        cell, speed, direction = (np.concatenate(parts) for parts in (cells, speeds, directions))
        crossed = speed != 0.0
        return cell[crossed], speed[crossed], direction[crossed]

    def _make_consistent(self) -> None:
        """Change the velocities on faces by the gradient of a potential, so that no cell with air has divergence."""
        size = self.solid.size
        lower, upper, speed = (np.concatenate(parts) for parts in zip(*self.faces, strict=True))
        edge, outflow = self.edges
        divergence = (
            np.bincount(lower, speed, size)
            - np.bincount(upper, speed, size)
            + np.bincount(edge, outflow, size)
        )
        if np.abs(divergence).max() > 1e-12:
            links = np.ones(len(lower))
            diagonal = (
                np.bincount(lower, links, size)
                + np.bincount(upper, links, size)
                + np.bincount(edge, minlength=size)
            )
            ones = -np.ones(len(lower))
            i, j = np.concatenate([lower, upper]), np.concatenate([upper, lower])
            # cells that no open edge is joined to have a free constant: a small term fixes it
            matrix = sparse.csc_array(
                (np.concatenate([np.concatenate([ones, ones]), diagonal + 1e-9]), _with_diagonal(i, j, size)),
                (size, size),
            )
            potential = _solver(matrix, self.dim)(divergence, "N")
            speed = speed - (potential[lower] - potential[upper])
            self.edges = edge, outflow - potential[edge]
        ends = np.cumsum([len(face[2]) for face in self.faces])[:-1]
        self.faces = [(a, b, u) for (a, b, _), u in zip(self.faces, np.split(speed, ends), strict=True)]

    @property
    def wind(self) -> np.ndarray:
        """Mass-consistent wind at the centres of the cells, the mean of each cell's faces, (*shape, dim) [m/s]."""
        result = np.zeros((self.solid.size, self.dim))
        for axis, (lower, upper, speed) in enumerate(self.faces):
            result[:, axis] += np.bincount(lower, 0.5 * speed, self.solid.size)
            result[:, axis] += np.bincount(upper, 0.5 * speed, self.solid.size)
        np.add.at(result, self.edges[0], 0.5 * self.edges[1][:, None] * self.outward)
        return result.reshape(*self.shape, self.dim)

    # ------------------------------------------------------------ equations

    @cached_property
    def matrix(self) -> sparse.csc_array:
        """Matrix A of A c = q, (cells, cells) [m³/s]; the identity for solid cells."""
        size, area, h = self.solid.size, self.area, self.cell
        lower, upper, u = (np.concatenate(parts) for parts in zip(*self.faces, strict=True))
        spread = np.maximum(self.diffusivity / h, 0.5 * np.abs(u))
        of_lower, of_upper = (
            area * (0.5 * u + spread),
            area * (0.5 * u - spread),
        )  # of the flux from lower to upper
        edge, outflow = self.edges
        diagonal = np.where(self.solid.ravel(), 1.0, self.volume * self.loss)
        diagonal += np.bincount(lower, of_lower, size) - np.bincount(upper, of_upper, size)
        diagonal += np.bincount(edge, area * np.maximum(outflow, 0.0), size)
        if self.loss == 0.0 and not (outflow > 0.0).any():
            raise ValueError("lifetime: no gas leaves through an edge of the domain; give a lifetime [s]")
        i, j = np.concatenate([lower, upper]), np.concatenate([upper, lower])
        return sparse.csc_array(
            (np.concatenate([of_upper, -of_lower, diagonal]), _with_diagonal(i, j, size)), (size, size)
        )

    @cached_property
    def _solve(self) -> "_Solver":
        return _solver(self.matrix, self.dim)

    def _solved(self, right: np.ndarray, trans: str) -> np.ndarray:
        right = np.asarray(right, float)
        if right.shape[right.ndim - self.dim :] != self.shape or right.ndim < self.dim:
            raise ValueError(f"got the shape {right.shape}; must end in {self.shape}")
        columns = np.where(self.solid, 0.0, right).reshape(-1, self.solid.size)
        result = self._solve(columns.T, trans).T
        return result.reshape(right.shape)


_Solver = Callable[[np.ndarray, str], np.ndarray]


def _with_diagonal(i: np.ndarray, j: np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray]:
    """Return rows and columns of a sparse matrix whose entries at (i, j) precede those of the diagonal."""
    own = np.arange(size)
    return np.concatenate([i, own]), np.concatenate([j, own])


def _solver(matrix: sparse.csc_array, dim: int) -> _Solver:
    """Return a function that solves A x = b, trans "N", or Aᵀ x = b, trans "T", for the columns of b (cells, ...).

    It is a factorisation of A or, for many cells, GMRES with an incomplete factorisation. Raises ValueError if the
    iterations do not converge.
    """
    size, _ = cast(tuple[int, int], matrix.shape)
    if size <= (MOST_DIRECT if dim == 3 else 10 * MOST_DIRECT):
        factors: SuperLU = splu(
            matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
        )
        return lambda right, trans: factors.solve(np.ascontiguousarray(right), trans)
    partial = spilu(matrix, drop_tol=1e-2, fill_factor=10.0, diag_pivot_thresh=0.0)

    def solve(right: np.ndarray, trans: str) -> np.ndarray:
        operator = matrix if trans == "N" else matrix.T
        preconditioner = LinearOperator(matrix.shape, lambda b: partial.solve(b, trans))
        columns = right.reshape(len(right), -1)
        result = np.zeros(columns.shape)
        for k, column in enumerate(columns.T):
            if column.any():
                result[:, k], failed = gmres(operator, column, rtol=TOLERANCE, maxiter=50, M=preconditioner)
                if failed:
                    raise ValueError(
                        "dispersion: the iterations do not converge; raise diffusivity or the cells"
                    )
        return result.reshape(right.shape)

    return solve
