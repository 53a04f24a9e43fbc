"""Imported flow (CFD results of other programs): interpolated to the grid and projected on divergence-free fields."""

from collections.abc import Callable, Sequence
from math import sqrt
from weakref import WeakKeyDictionary

import numpy as np

from taichi_plume.files.film import VELOCITIES
from taichi_plume.files.wind_points import Points
from taichi_plume.files.wind_site import Site
from taichi_plume.grid.cut_cells import Air
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.interpolation import Interpolation
from taichi_plume.solvers.playback import PlayedWind
from taichi_plume.solvers.pressure import pressure_solver

LEFT = 1e-6  # divergence that may be left, over the largest |u|/dx
ROUNDS = 8  # limit of the pressure solver's residual in single precision


class Projection:
    """Projection of face velocities to the nearest divergence-free flow with the same flux through the domain's faces.

    walls: names of faces of the domain that are closed.
    """

    def __init__(self, grid: Grid, air: Air, walls: Sequence[str] = ()):
        self.grid = grid
        self.area = [area.astype(float) for area in air.area]
        self.regions = air.regions()
        self.inside = []
        for d, area in enumerate(self.area):
            along = np.moveaxis(area, d, 0)
            for end, name in ((0, f"{'xyz'[d]}-"), (-1, f"{'xyz'[d]}+")):
                if name in walls:
                    along[end] = 0.0
            inside = np.moveaxis(area.copy(), d, 0)
            inside[0] = inside[-1] = 0.0
            self.inside.append(np.moveaxis(inside, 0, d))
        self.solver = pressure_solver(tuple(grid.pad_faces(a, d) for d, a in enumerate(self.inside)), grid)
        self._b, self._phi = grid.field(), grid.field()

    def _net_inflow(self, u: list[np.ndarray]) -> np.ndarray:
        """Return the net inflow of each cell divided by the area of a face [m/s]; u: velocities at the faces."""
        flux = [a * v for a, v in zip(self.area, u, strict=True)]
        return np.sum(
            [np.delete(f, -1, axis=d) - np.delete(f, 0, axis=d) for d, f in enumerate(flux)], axis=0
        )

    def _balance(self, u: list[np.ndarray]) -> None:
        """Scale inflow and outflow through the domain's faces to their mean, for each connected part of the air."""
        flows = np.zeros((2, self.regions.max() + 1))  # in, out
        sides = []
        for d, v in enumerate(u):
            for end, inward in ((0, 1.0), (-1, -1.0)):
                face = np.moveaxis(v, d, 0)[end]  # a view
                flux = inward * face * np.moveaxis(self.area[d], d, 0)[end]
                region = np.moveaxis(self.regions, d, 0)[end]
                np.add.at(flows[0], region, np.maximum(flux, 0.0))
                np.add.at(flows[1], region, np.maximum(-flux, 0.0))
                sides.append((face, region, (flux < 0.0).astype(int)))
        mean = np.where((flows > 0.0).all(axis=0), flows.mean(axis=0), 0.0)
        factor = mean / np.maximum(flows, 1e-30)
        for face, region, out in sides:
            face *= factor[out, region]

    def __call__(self, u: list[np.ndarray]) -> tuple[list[np.ndarray], float, float]:
        """Return the nearest divergence-free face velocities, their change (root mean square over that of u in the
        air), and the remaining divergence over the largest |u|/dx.
        """
        air = [area > 0.0 for area in self.area]
        given = np.concatenate([v[o] for v, o in zip(u, air, strict=True)])
        u = [np.where(o, v, 0.0) for v, o in zip(u, air, strict=True)]
        self._balance(u)
        fastest = max(max(float(np.abs(v).max()) for v in u), 1e-6)
        for _ in range(ROUNDS):
            net = self._net_inflow(u)
            most = float(np.abs(net).max())
            if most < LEFT * fastest:
                break
            self.grid.write(self._b, net / most)  # single precision is enough for a residual
            self.solver.solve(self._b, self._phi, 1e-4)
            phi = most * self.grid.read(self._phi).astype(float)
            for d, v in enumerate(u):
                open_ = np.moveaxis(self.inside[d], d, 0)[1:-1] > 0.0
                np.moveaxis(v, d, 0)[1:-1] -= open_ * np.diff(np.moveaxis(phi, d, 0), axis=0)
        u = [v.astype(np.float32) for v in u]
        changed = np.concatenate([v[o] for v, o in zip(u, air, strict=True)]) - given
        left = float(np.abs(self._net_inflow(u)).max()) / fastest
        return u, sqrt(np.mean(changed**2) / max(np.mean(given**2), 1e-30)), left


_films: "WeakKeyDictionary[Site, ImportedFilm]" = WeakKeyDictionary()  # of the scenarios in use


class ImportedFilm:
    """Frames of an imported wind in memory, interpolated to the grid, with the interface of a `Film` (recorded run).

    diagnostics: maxima over all frames: change by the projection, root mean square over that of the velocity; remaining
    divergence over the largest |u|/dx; speed through a face [m/s].
    """

    @classmethod
    def of(cls, site: Site, grid: Grid, air: Air) -> "ImportedFilm":
        """Return the film of a site, computed once for equal air. Raises WindFileError."""
        known = _films.get(site)
        if known is None or not all(map(np.array_equal, known._air.area, air.area)):
            known = _films[site] = cls(site, grid, air)
        return known

    def __init__(self, site: Site, grid: Grid, air: Air):
        """Read, interpolate and project all wind files. Raises WindFileError."""
        self.grid, self._air, self._site = grid, air, site
        wind = site.wind
        self.attributes = {"viscosity": wind.viscosity, "schmidt": wind.schmidt}
        self.times = np.array([time for time, _ in site.files])
        self._project = Projection(grid, air, wind.walls)
        self.diagnostics = {"correction": 0.0, "max_divergence": 0.0, "max_speed": 0.0}
        self._place = np.empty(0)
        self._frames = [self._frame(site.read(path)) for _, path in site.files]
        self.wind = list(self._frames[0])

    def still(self, name: str) -> np.ndarray:
        """Return for name "open_u", "open_v" or "open_w" which faces inside the domain let air through."""
        return self._project.inside[VELOCITIES.index(name.removeprefix("open_"))] > 0.0

    def air(self) -> Air:
        """Return the geometry of the air: solid cells and open areas of faces."""
        return self._air

    def frame(self, n: int, names: list[str]) -> dict[str, np.ndarray]:
        """Return the variables `names` of frame n as arrays with axes (x, y, z); viscosity includes that of eddies."""
        frame = {name: self._frames[n][name] for name in names}
        if "viscosity" in frame:
            eddies, given = frame["viscosity"], self._site.wind.eddy_viscosity
            eddies = eddies if given is None else np.full_like(eddies, given)
            frame["viscosity"] = np.asarray(self._site.wind.viscosity + eddies, np.float32)
        return frame

    def _frame(self, points: Points) -> dict[str, np.ndarray]:
        """Interpolate points to the grid and project; return velocities and, as `viscosity`, the eddy viscosity."""
        dim, wind = self.grid.dim, self._site.wind
        if not np.array_equal(points.place, self._place):
            self._place, known = points.place, Interpolation(points.place)
            self._to_faces = [known.onto(self._site.places(self.grid, d)) for d in range(dim)]
            if points.eddy_viscosity is not None:
                self._to_cells = known.onto(self._site.places(self.grid))
        wide = [self._onto(self._to_faces[d], points.velocity[:, d]) for d in range(dim)]
        inner = [tuple(slice(None) if a == d else slice(1, -1) for a in range(dim)) for d in range(dim)]
        faces, correction, left = self._project([v[i] for v, i in zip(wide, inner, strict=True)])
        for v, i, u in zip(wide, inner, faces, strict=True):
            v[i] = u
        frame: dict[str, np.ndarray] = {
            name: u.astype(np.float32) for name, u in zip(VELOCITIES, wide, strict=False)
        }
        if wind.eddy_viscosity is not None:
            frame["viscosity"] = np.zeros([n + 2 for n in self.grid.shape])
        elif points.eddy_viscosity is not None:
            frame["viscosity"] = np.maximum(self._onto(self._to_cells, points.eddy_viscosity), 0.0)
        found = (correction, left, max(float(np.abs(u).max()) for u in faces))
        self.diagnostics = {
            name: max(largest, value)
            for (name, largest), value in zip(self.diagnostics.items(), found, strict=True)
        }
        return frame

    def _onto(self, interpolate: Callable, values: np.ndarray) -> np.ndarray:
        """Return interpolated values on the grid; a 2-D run drops the axis normal to its plane."""
        result = np.array(interpolate(values))
        return result[..., 0] if result.ndim > self.grid.dim else result


class ImportedFlow(PlayedWind):
    """Flow that another program (CFD) computed, played back from its imported files."""

    frames: ImportedFilm

    def diagnostics(self) -> dict[str, float]:
        return self.frames.diagnostics
