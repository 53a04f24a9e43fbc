"""Laws of gas and wind of the user's own: Python functions of positions and time, in NumPy.

    def concentration(points, t, *, rate=1.0):  # points (n, 2 or 3) [m], t [s]
        return 50 * np.exp(-((points[:, 1] - 1.5) ** 2) / 0.1)  # (n,) [ppm]

    def velocity(points, t):
        return [0.5, 0.1 * np.sin(points[:, 0] - t)]  # components [m/s], or an array (n, 2 or 3)

Files are executed only with --allow-code. A law must be a function of its arguments alone, as a resumed run calls it
only for later times. Concentrations are computed at the centres of cells, velocities at the centres of their faces;
both are linear in between. Velocities are projected on the nearest divergence-free flow (see `imported_flow`), as a
flow with divergence would not conserve the gas that it carries.
"""

from collections.abc import Callable
from inspect import signature
from math import inf
from typing import Any

import numpy as np

from taichi_plume.files.own_class import OwnAlgorithmError, failures_named, file_of
from taichi_plume.grid.cut_cells import Air
from taichi_plume.grid.fields import Carrier, GridGas
from taichi_plume.grid.grid import Grid
from taichi_plume.scenario.own_code import OwnGas, OwnLaw, OwnWind
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.scenario.species import AIR_VISCOSITY
from taichi_plume.solvers.imported_flow import Projection


class Law:
    """User's function with the parameters of its section. Raises OwnAlgorithmError if the function fails.

    shape: of the value at a point: () for concentrations, (dim,) for velocities. Raises ValueError if the function does
    not take the parameters.
    """

    def __init__(self, section: OwnLaw, function: Callable[..., Any], shape: tuple[int, ...] = ()):
        self.function, self.parameters, self.shape = function, section.parameters, shape
        self.path = file_of(function)
        self.where = f"{self.path}, {section.name or section.function}"
        try:
            signature(function).bind(None, 0.0, **self.parameters)
        except TypeError as error:
            raise ValueError(f"parameters: do not fit {self.where}: {error}") from None
        except ValueError:
            pass  # compiled functions may have no signature

    def __call__(self, points: np.ndarray, t: float) -> np.ndarray:
        """Return the law's values at points (n, dim) [m] and time t [s], (n, *shape)."""
        shape = (len(points), *self.shape)
        with failures_named(self.path):
            returned = self.function(points.copy(), t, **self.parameters)
        try:
            if isinstance(returned, list | tuple) and (len(returned),) == self.shape:  # components
                returned = np.stack(np.broadcast_arrays(*returned), axis=-1)
            if np.iscomplexobj(returned):
                raise OwnAlgorithmError(f"{self.where}: returned complex numbers, not real ones")
            values = np.broadcast_to(np.asarray(returned, float), shape)
        except (TypeError, ValueError):
            raise OwnAlgorithmError(f"{self.where}: returned {_form(returned)}, not {shape}") from None
        with np.errstate(over="ignore"):  # fields are f32
            finite = np.isfinite(values.astype(np.float32))
        if not finite.all():
            n = int(np.argwhere(~finite)[0, 0])
            place = ", ".join(f"{x:g}" for x in points[n])
            raise OwnAlgorithmError(
                f"{self.where}: returned {values[n]} at ({place}) m, t = {t:g} s, not finite numbers"
            )
        return values


def _form(returned: object) -> str:
    """Return the shape of what a law returned, as text."""
    try:
        return f"the shape {np.shape(returned)}"  # type: ignore[arg-type]
    except (TypeError, ValueError):
        return "parts of different shapes"


class OwnGasField(GridGas):
    """Gas whose concentration [ppm] a user's function gives at the centres of all cells."""

    STATE = ("c",)

    def __init__(self, gas: OwnGas, law: Callable[..., Any], grid: Grid, air: Air, t: float = 0.0):
        self.grid, self.dim = grid, grid.dim
        self.species = gas.vapour
        self.law = Law(gas, law)
        self.points = grid.centers().reshape(-1, grid.dim)
        self.c = grid.field()
        self.air = grid.filled(grid.pad(~air.solid))
        self.advance(t, 0.0)

    def advance(self, t: float, dt: float) -> None:
        ppm = self.law(self.points, t + dt)
        if (ppm < 0.0).any():
            n = int(np.flatnonzero(ppm < 0.0)[0])
            place = ", ".join(f"{x:g}" for x in self.points[n])
            raise OwnAlgorithmError(
                f"{self.law.where}: returned {ppm[n]:g} ppm at ({place}) m, t = {t + dt:g} s; must not be negative"
            )
        density = ppm.reshape(self.grid.shape) / self.species.ppm_per_density
        self.grid.write(self.c, self.grid.pad(density), self.grid.ghost)


class OwnFlow(Carrier):
    """Wind whose velocity [m/s] a user's function gives at the faces of all cells."""

    STATE = ("u", "outflow_rate", "max_speed", "correction", "divergence", "_shown")

    def __init__(
        self,
        wind: OwnWind,
        law: Callable[..., Any],
        grid: Grid,
        air: Air,
        scenario: Scenario,
        t: float = 0.0,
    ):
        self.grid, self.dim = grid, grid.dim
        self.law = Law(wind, law, (grid.dim,))
        self.viscosity = self.max_viscosity = AIR_VISCOSITY
        self.carries = any(gas.solved for _, gas in scenario.gases)
        self._project = Projection(grid, air)
        self._shapes = [tuple(n + (a == d) for a, n in enumerate(grid.shape)) for d in range(grid.dim)]
        self._faces = [
            (np.moveaxis(np.indices(shape), 0, -1).reshape(-1, grid.dim) + 0.5) * grid.dx
            for shape in self._shapes
        ]
        for d, points in enumerate(self._faces):
            points[:, d] -= 0.5 * grid.dx
        self.u = grid.faces_field()
        inside = (inside > 0.0 for inside in self._project.inside)
        self.open = tuple(grid.filled(self._padded(open_, d)) for d, open_ in enumerate(inside))
        self.area = None
        if not air.empty:
            self.area = tuple(grid.filled(grid.pad_faces(area, d)) for d, area in enumerate(air.area))
        self.correction = self.divergence = self.max_speed = 0.0
        self._shown = np.empty(0)  # velocities by the law that the fields hold, projected
        self.advance(t, 0.0)

    def _padded(self, faces: np.ndarray, d: int) -> np.ndarray:
        """Return flags of the faces of axis d, with ghost layers that are 0."""
        ghost = self.grid.ghost
        return np.pad(faces, [(ghost, ghost - (a == d)) for a in range(self.dim)])

    def stable_dt(self, t: float = 0.0) -> float:
        """Return the longest stable time step [s] of gas that the wind carries; infinite if the wind carries none."""
        return 0.5 / max(self.outflow_rate, 1e-9) if self.carries else inf

    def advance(self, t: float, dt: float) -> None:
        given = np.concatenate([self.law(points, t + dt)[:, d] for d, points in enumerate(self._faces)])
        if np.array_equal(given, self._shown):
            return
        ends = np.cumsum([len(points) for points in self._faces])
        parts = [part.reshape(s) for part, s in zip(np.split(given, ends[:-1]), self._shapes, strict=True)]
        faces, correction, divergence = self._project(parts)
        for d, values in enumerate(faces):
            self.u[d].from_numpy(self.grid.pad_faces(values, d))
        self.outflow_rate = self.grid.largest_outflow(faces)
        self.max_speed = max(float(np.abs(values).max()) for values in faces)
        self.correction = max(self.correction, correction)
        self.divergence = max(self.divergence, divergence)
        self._shown = given

    def diagnostics(self) -> dict[str, float]:
        """Return the largest change by the projection, over the velocity; the divergence left; the top speed [m/s]."""
        return {
            "correction": self.correction,
            "max_divergence": self.divergence,
            "max_speed": self.max_speed,
        }
