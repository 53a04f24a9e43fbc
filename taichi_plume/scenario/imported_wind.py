"""Imported wind: flow files of other programs, and checks that they cover the simulated domain."""

from collections.abc import Iterator
from math import inf
from typing import Annotated, ClassVar, Literal

from pydantic import BeforeValidator, Field

from taichi_plume.scenario import si
from taichi_plume.scenario.playback import Played
from taichi_plume.scenario.vocabulary import Face, FileName
from taichi_plume.scenario.wind_base import AnyWind

ColumnName = Annotated[str, BeforeValidator(lambda name: str(name) if isinstance(name, int) else name)]


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
