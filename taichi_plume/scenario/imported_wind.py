"""Imported wind: flow files of other programs, and checks that they cover the simulated domain."""

from collections.abc import Iterator
from math import inf, prod
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

import numpy as np
import psutil
from pydantic import BeforeValidator, Field

from taichi_plume.scenario import si
from taichi_plume.scenario.domain import Context
from taichi_plume.scenario.playback import Played
from taichi_plume.scenario.vocabulary import Face, FileName
from taichi_plume.scenario.wind_base import AnyWind

if TYPE_CHECKING:
    from taichi_plume.files.gaden import Cubes
    from taichi_plume.files.wind_site import Site

ColumnName = Annotated[str, BeforeValidator(lambda name: str(name) if isinstance(name, int) else name)]
ROUNDING = 0.01  # cells by which the domain may exceed the points


class ImportedWind(AnyWind, Played):
    """Air flow from files of OpenFOAM, ParaView, Fluent or GADEN. See files/wind_points.py and files/openfoam.py.

    The flow is linear between points and between the times of files, and made divergence-free. Air goes through the
    faces of the domain as in the files, except for an even part that balances inflow and outflow.
    """

    key: ClassVar[str] = "files"
    kind: Literal["imported"]
    files: FileName
    """Path of a file, or of several, relative to the scenario's folder. %d stands for numbers that count up by one,
    such as in wind_at_cell_centers_%d.csv, %g for times in s, such as in postProcessing/cloud/%g/points_U.xy. A case
    folder of OpenFOAM stands for all of its times, whole or decomposed, or for the last if the case is steady,
    CASE/TIME for one of them, CASE/REGION for a region. wind_iteration_%d and NAME_%d.csv_U are binary winds of
    GADEN."""
    interval: si.Duration = 1.0
    """Time from one numbered file to the next; the first is of time 0."""
    loop_from: si.Time | None = None
    """Time of the first file that `loop` repeats; earlier files are played once. Unless given, the first of all."""
    loop_to: si.Time | None = None
    """Time of the last file that `loop` repeats; later files are not played. Unless given, the last of all."""
    origin: si.Point | None = None
    """Where the domain's lower corner lies in the files. Unless given, the lower corner of the occupancy grid, or
    without one that of the mesh or the points."""
    height: si.Coordinate | None = None
    """Height z in the files at which a 2-D run cuts them; unless given, the middle of the points."""
    columns: dict[Literal["x", "y", "z", "u", "v", "w", "nut"], ColumnName] = Field(default_factory=dict)
    """Names of a table's columns for x, y, z, u, v, w and nut, or their numbers from 1 on. A name may have a unit: {x:
    "pos (mm)"}. Unless given, they are found by the names that programs write."""
    points: Literal["nodes", "centres"] | None = None
    """Meaning of a table's points: nodes lie on the boundary of the flow, centres of cells half a cell inside. Unless
    given, the header or the positions of the points say it."""
    missing: Annotated[tuple[si.Missing, ...], Field(max_length=100)] = ()
    """Numbers in a table that mean no velocity, besides -999 and -9999. Such points are left out."""
    occupancy: FileName | None = None
    """Path of an OccupancyGrid3D.csv of GADEN's: obstacles besides the scenario's own. A config.yaml or
    preproc_params.yaml of GADEN's, or its simulations/SIM.yaml, stands for the grid of the STL models that it lists."""
    walls: tuple[Face, ...] = ()
    """Faces of the domain that let no air through; through the others air goes as in the files."""
    viscosity: si.Viscosity = 1.56e-5
    """Kinematic viscosity: the default is air at 25 °C."""
    eddy_viscosity: si.EddyDiffusivity | None = None
    """Viscosity of the turbulence that the files do not resolve, which mixes the gas. Unless given, the column nut of
    the files, or none."""
    schmidt: si.Prandtl = 0.7
    """Turbulent Schmidt number: eddy viscosity over eddy diffusivity of gas. A smaller one mixes gas more."""

    def dimension_errors(self, where: str, dim: int) -> Iterator[str]:
        yield from super().dimension_errors(where, dim)
        if dim == 3 and self.height is not None:
            yield f"{where}.height: is for 2-D runs; remove it, or give domain.size two numbers"

    @property
    def looped(self) -> tuple[float, float]:
        first, last = self.loop_from, self.loop_to
        return -inf if first is None else first, inf if last is None else last

    def _loop_errors(self, where: str, site: "Site") -> Iterator[str]:
        """Yield errors of `loop_from` and `loop_to`, which name times of files."""
        times = [time for time, _ in site.files]
        for key in ("loop_from", "loop_to"):
            time = getattr(self, key)
            if time is None:
                continue
            if not self.loop:
                yield f"{where}.{key}: repeats nothing without loop: true"
            elif not times[0] <= time <= times[-1]:
                yield f"{where}.{key}: {time:g} s is outside of the files, {times[0]:g} to {times[-1]:g} s"
        first, last = self.looped
        if not any(first <= time <= last for time in times):
            yield f"{where}.loop_from: no file is from {first:g} s to loop_to, {last:g} s"

    def file_errors(self, where: str, context: Context) -> Iterator[str]:
        """Yield errors found in the first and last wind file; the other files are read at the start of the run."""
        site = context.resources.site
        assert site is not None
        yield from self._loop_errors(where, site)
        low, high = site.levels
        if self.height is not None and not low <= self.height <= high:
            yield f"{where}.height: {self.height:g} m is outside of {site.first.path}, z {low:g} to {high:g} m"
            return
        yield from self.too_late(where, context)
        domain = context.domain
        needed = 4.0 * len(site.files) * prod(n + 2 for n in domain.shape) * (domain.dim + 1)
        free = psutil.virtual_memory().available
        if needed > free:
            yield (
                f"{where}.files: {len(site.files)} files on this grid need {needed / 1e9:.2g} GB of memory, "
                f"{free / 1e9:.2g} GB are free; use fewer, or raise domain.spacing"
            )
        errors = list(self._beyond_cubes(site, context))
        yield from errors
        if not errors:
            yield from self._without_wind(site, context)
            if site.cubes is not None:
                yield from self._in_cubes(site, site.cubes, context)

    def recorded(self, where: str, context: Context) -> tuple[str | Path, int, float]:
        site = context.resources.site
        assert site is not None
        last, path = site.files[-1]
        return path, len(site.files), last

    def _beyond_cubes(self, site: "Site", context: Context) -> Iterator[str]:
        """Yield an error for each axis along which the domain reaches beyond GADEN's occupancy grid."""
        if site.cubes is None:
            return
        slack = ROUNDING * context.domain.spacing
        for a, extent in enumerate(context.domain.extent):
            low, high = site.cubes.low[a], site.cubes.high[a]
            if low > slack or extent > high + slack:
                yield _outside(site, a, (0.0, extent), (low, high), f"{self.occupancy} has cells")

    def _without_wind(self, site: "Site", context: Context) -> Iterator[str]:
        """Yield an error for each axis along which grid cells with air lie beyond the points of the wind file."""
        cells = np.argwhere(~context.resources.solid())
        if not len(cells):
            yield f"wind.occupancy: {self.occupancy}: leaves no air in the domain"
            return
        dx = context.domain.spacing
        slack = ROUNDING * dx + site.slack
        for a in range(context.domain.dim):
            low, high = cells[:, a].min() * dx, (cells[:, a].max() + 1) * dx
            if low < site.low[a] - slack or high > site.high[a] + slack:
                have = f"{site.first.path} has points"
                yield _outside(site, a, (low, high), (site.low[a], site.high[a]), have)

    def _in_cubes(self, site: "Site", cubes: "Cubes", context: Context) -> Iterator[str]:
        """Yield errors of a raised floor, and of sources and robots inside obstacles, in GADEN's occupancy grid."""
        file = self.occupancy
        if context.scenario.robots and context.scenario.domain.dim == 3:
            floor = int((~cubes.solid).any(axis=(0, 1)).argmax())  # the lowest layer with air
            low = cubes.low[2] + floor * cubes.size
            if low > ROUNDING * context.scenario.domain.spacing:
                yield (
                    f"wind.origin: the floor of {file} is {low:.4g} m above the floor of the domain; use "
                    f"{low + site.origin[2]:.6g} as third number"
                )
                return
        for path, source in context.scenario.sources:
            place = np.array([source.position])
            if place.shape[1] == context.scenario.domain.dim and cubes.inside(place)[0]:
                yield f"{path}.position: is inside an obstacle of {file}; move the source"
        for n, group in enumerate(context.scenario.robots):
            places = group.places(context.scenario.floor)
            if places is not None:
                away = cubes.horizontal_distance(places, 0.0, group.body.height)
                each = ".positions[{}]:" if len(group.start.listed) else ": robot {}"
                for k in np.flatnonzero(away < group.body.radius):
                    yield f"robots[{n}].start{each.format(k)} touches an obstacle of {file}; move the robot"


def _outside(site: "Site", axis: int, air: tuple[float, float], known: tuple[float, float], have: str) -> str:
    """Return an error: along an axis the range `air` [m] of the domain reaches beyond the range `known` of a file."""
    x, origin = "xyz"[axis], site.origin[axis]
    (a, b), (low, high) = air, known
    places = [f"{round(origin + place, 6) + 0.0:g}" for place in (a, b, low, high)]
    return (
        f"domain.size[{axis}]: the domain's air is at {x} = {places[0]} to {places[1]} m of the files, but {have} only "
        f"at {places[2]} to {places[3]} m; use at most {high - low:.6g} m, and {places[2]} as number {axis + 1} of "
        "wind.origin, written into the scenario's file (positions of sources, robots and obstacles count from there)"
    )
