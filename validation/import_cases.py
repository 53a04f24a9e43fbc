"""Imported wind: error of the interpolation of point files of a known flow."""

from functools import partial
from math import pi
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from taichi_plume.files.wind_site import Site
from taichi_plume.grid.cut_cells import air_of
from taichi_plume.grid.fields import velocity_at
from taichi_plume.grid.grid import Grid
from taichi_plume.scenario.imported_wind import ImportedWind
from taichi_plume.solvers.imported_flow import ImportedFilm, ImportedFlow
from taichi_plume.validation.case import SECOND_ORDER, Answer, Case, Curve, Expected

HEADER = '"U:0","U:1","U:2","Points:0","Points:1","Points:2"'


def vortices(x: np.ndarray) -> np.ndarray:
    """Return a divergence-free velocity at points (..., 2 or 3) [m], period 1 m (2-D: Taylor-Green, 3-D: ABC flow)."""
    turned = 2.0 * pi * x + [0.3, 0.7, 1.1][: x.shape[-1]]
    s, c = np.sin(turned), np.cos(turned)
    if x.shape[-1] == 2:
        return np.stack([s[..., 0] * c[..., 1] + 0.5, -c[..., 0] * s[..., 1]], axis=-1)
    return np.stack(
        [s[..., 2] + c[..., 1], 0.7 * (s[..., 0] + c[..., 2]), 0.5 * (s[..., 1] + c[..., 0])], axis=-1
    )


def imported_wind(n: int, dim: int, jitter: float) -> Answer:
    """Return errors of a wind imported on n cells per metre, in a box 1 m wide, from points 0.8 cells apart.

    jitter: largest displacement of the points from a lattice, over their distance; their order is random.
    """
    rng = np.random.default_rng(1)
    m = 5 * n // 4
    places = np.stack(np.meshgrid(*[np.arange(m) + 0.5] * dim, indexing="ij"), axis=-1).reshape(-1, dim)
    places = rng.permutation((places + rng.uniform(-jitter, jitter, places.shape)) / m)
    missing = np.zeros((len(places), 3 - dim))
    columns = np.hstack([vortices(places), missing, places, missing])
    model = ImportedWind(kind="imported", files="wind.csv", origin=(0.0,) * dim)
    grid = Grid((n,) * dim, 1.0 / n)
    with TemporaryDirectory() as folder:
        np.savetxt(Path(folder) / "wind.csv", columns, fmt="%.8g", delimiter=",", header=HEADER, comments="")
        film = ImportedFilm(Site(model, grid.extent, Path(folder)), grid, air_of([], grid))
    wind = ImportedFlow(model, film, grid)
    points = rng.uniform(0.0, 1.0, (4000, dim))
    exact = vortices(points)
    error = velocity_at(wind, points, 0.0) - exact
    diagnostics = wind.diagnostics()
    line = np.full((101, dim), 0.5)
    line[:, 0] = np.linspace(0.0, 1.0, 101)
    return {
        "u / u_max, rms": float(np.sqrt(np.mean(error**2)) / np.abs(exact).max()),
        "correction": diagnostics["correction"],
        "divergence": diagnostics["max_divergence"],
        "velocity across the line": Curve(
            "x [m]", "v [m/s]", line[:, 0], velocity_at(wind, line, 0.0)[:, 1], vortices(line)[:, 1]
        ),
    }


def _case(
    name: str, about: str, dim: int, jitter: float, coarse: tuple[int, ...], fine: tuple[int, ...]
) -> Case:
    return Case(
        name,
        about,
        "the flow that was written",
        partial(imported_wind, dim=dim, jitter=jitter),
        evidence="exact",
        coarse=coarse,
        fine=fine,
        expected={
            "u / u_max, rms": SECOND_ORDER,
            "correction": SECOND_ORDER,
            "divergence": Expected(tolerance=1e-5),  # single precision
        },
    )


CASES = (
    _case("imported_wind", "air flow from a lattice of points", 2, 0.0, (16, 32), (32, 64, 128)),
    _case("imported_wind_mesh", "air flow from points in disorder", 3, 0.25, (12, 24), (16, 32, 64)),
)
