"""Plumes of sources smaller than a cell: independence of the source's position in its cell and of the wind direction.

Functions solve at a resolution, see `case`."""

from collections.abc import Iterator
from functools import partial
from itertools import product

import numpy as np

from taichi_plume.grid.fields import concentration_at
from taichi_plume.grid.grid import Grid
from taichi_plume.scenario.winds import UniformWind
from taichi_plume.solvers.uniform_wind import UniformSolver
from taichi_plume.validation.case import Answer, Case, Curve, Expected
from taichi_plume.validation.setups import ethanol, gas_on

SPEED, RADIUS = 0.5, 0.02  # m/s, m
EDDIES = 1e-4
"""Subgrid eddy diffusivity [m²/s], typical of cells of 5 cm in a wind of 0.5 m/s with an intensity of 10 %."""


class Plume:
    """Gas of a small source in a uniform wind, for each position and wind."""

    def __init__(self, grid: Grid, diffusivity: float, convection: str = "koren"):
        self.grid = grid
        self.keys = {"convection": convection, "species": ethanol(diffusivity)}

    def blowing(self, slope: float) -> UniformWind:
        """Return a wind section along x with `slope` times that speed along y."""
        velocity = (SPEED, SPEED * slope, 0.0)[: self.grid.dim]
        return UniformWind(kind="uniform", velocity=velocity)

    def steady(self, place: tuple[float, ...], slope: float = 0.0, courant: float = 1.2) -> None:
        """Emit from a source at `place` [m] for 1.25 flow-through times; slope: of the wind."""
        source = {"position": place, "rate": 1e-6, "radius": RADIUS}
        wind = UniformSolver(self.blowing(slope), self.grid)
        self.gas = gas_on(self.grid, wind, **self.keys, sources=[source])
        dt = courant * self.grid.dx / (SPEED * (1.0 + slope))
        for _ in range(round(1.25 * self.grid.extent[0] / SPEED / dt)):
            self.gas.advance(0.0, dt)


def source_places(n: int) -> Answer:
    """Return the scatter of c on the plume's axis over 27 source positions in a cell: largest over smallest, less 1."""
    grid = Grid((round(1.5 * n), 13, 13), 1.0 / n)
    plume, seen = Plume(grid, EDDIES), []
    for inside in product((0.0, 0.5, 1.0 - 1e-6), repeat=3):
        place = tuple((np.array((4, 6, 6)) + inside) * grid.dx)
        plume.steady(place)
        ahead = np.array([(0.25, 0.0, 0.0), (1.0, 0.0, 0.0)])
        seen.append(concentration_at(plume.gas, place + ahead, 0.0))
    near, far = np.transpose(seen)
    return {
        "c at 0.25 m": float(near.max() / near.min() - 1.0),
        "c at 1 m": float(far.max() / far.min() - 1.0),
    }


def _sections(
    plume: Plume, place: tuple[float, float], far: np.ndarray
) -> Iterator[tuple[float, float, float]]:
    """Yield exact distance [m], centroid [m] and variance [m²] of the gas in sections about `far` [m] downwind."""
    c, x = plume.gas.cells(0.0).astype(float), plume.grid.centers()
    for distance in far:
        row = int(np.abs(x[:, 0, 0] - place[0] - distance).argmin())
        y, shares = x[row, :, 1], c[row] / c[row].sum()
        middle = float(shares @ y)
        yield float(x[row, 0, 0] - place[0]), middle, float(shares @ (y - middle) ** 2)


def oblique_plume(n: int, convection: str) -> Answer:
    """Return errors of a thin plume in a wind askew to the grid, n cells per metre.

    Norms: relative error of the centroid's deflection 1 to 3 m behind the source; numerical diffusivity over U dx.
    Slopes 0.02, 0.05, 0.1; the source at a cell's centre, at its face and elsewhere.
    """
    grid = Grid((round(3.6 * n), round(1.3 * n)), 1.0 / n)
    molecules = 1e-5
    plume, far = Plume(grid, molecules, convection), np.linspace(1.0, 3.0, 9)
    wrong, widening, line = [], [], []
    for inside, slope in product(((0.5, 0.5), (0.5, 0.0), (0.31, 0.77)), (0.02, 0.05, 0.1)):
        place = ((4 + inside[0]) * grid.dx, (0.4 * n + inside[1]) * grid.dx)
        plume.steady(place, slope)
        behind, middle, variance = np.transpose(list(_sections(plume, place, far)))
        line = [behind, middle - place[1], slope * behind]
        wrong.extend(line[1] / line[2] - 1.0)
        spread = np.polyfit(behind / SPEED, variance, 1)[0] / 2.0
        widening.append((spread - molecules) / (SPEED * grid.dx))
    return {
        "deflection": float(np.abs(wrong).max()),
        "numerical diffusivity / (U dx)": float(max(widening)),
        "centroid": Curve("x [m]", "y [m]", *line),
    }


def _oblique(convection: str) -> Case:
    return Case(
        f"oblique_plume_{convection}",
        f"a thin plume askew to the grid, {convection}",
        "the way of the wind",
        partial(oblique_plume, convection=convection),
        evidence="exact",
        coarse=(20,),
        fine=(20, 40),
        expected={"deflection": Expected(tolerance=0.03)},
    )


CASES = (
    Case(
        "source_places",
        "a source of 2 cm at 27 positions in a cell, largest over smallest concentration, less 1",
        "independence of the position",
        source_places,
        evidence="exact",
        coarse=(20,),
        fine=(20,),
        expected={"c at 0.25 m": Expected(tolerance=0.1), "c at 1 m": Expected(tolerance=0.05)},
    ),
    _oblique("koren"),
    _oblique("weno5"),
)
