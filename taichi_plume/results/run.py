"""Results of a run for notebooks and plots: ``run = taichi_plume.open_run("runs/casting_room-1")``.

    run.fields      xarray.Dataset: wind, gas [ppm] and temperature over time, of a run with `fields` in its scenario;
                    values are read on use
    run.pictures    xarray.Dataset: gas and temperature on the planes of the recording; see `Run.pictures`
    run.winds       xarray.Dataset: wind on the planes of the recording
    run.robots      pandas.DataFrame: a row per robot and tick; units in `run.robots.attrs["units"]`
    run.probes      pandas.DataFrame, of a run with `probes`
    run.forces      pandas.DataFrame: the force of the air on each obstacle
    run.maps        list of xarray.Dataset: each gas map at the end, beside the truth
    run.beliefs     list of xarray.Dataset: posterior of the source position of each group at the end
    run.result      dict: result.json
    run.trials      pandas.DataFrame: a row per trial of each group, of a run that has ended
    run.scenario    Scenario: with every default
    run.sources_at  function from times [s] to the true positions of the sources [m]

Opening is instant; each part is read on first use. A running or killed run has the parts that reached the disk. Missing
or damaged parts raise RunFolderError with a message of one line.

Reports, pictures and films also use

    run.tracks      list of results.tracks.Track: robots of the first trial of each group over time
    run.shapes      shapes of the obstacles that may be read; `run.lacks` names the others
"""

import io
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cached_property
from itertools import takewhile
from pathlib import Path
from typing import TYPE_CHECKING, Any

from taichi_plume.files import manifest, pictures_file
from taichi_plume.files.run_folder import HEADER, KILLED, OURS, RunFolderError, is_run, read_json
from taichi_plume.files.tables import LONGEST_TEXT, plain
from taichi_plume.guard.safe_open import as_path, content_of, unopenable
from taichi_plume.guard.terminal import visible
from taichi_plume.guard.yaml_text import LARGEST_FILE
from taichi_plume.version import __version__

if TYPE_CHECKING:
    import numpy as np
    import pandas
    import pyarrow
    import xarray
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from taichi_plume.grid.shapes import Shape
    from taichi_plume.report.pictures import Film
    from taichi_plume.results.tracks import Track
    from taichi_plume.scenario.scenario import Scenario

LARGEST_CSV = 1 << 30  # bytes
FILES = {
    "fields": ("fields.zarr",),
    "pictures": ("pictures.zarr",),
    "robots": ("robots.parquet", "robots.arrows"),
    "probes": ("probes.parquet", "probes.arrows"),
    "forces": ("forces.csv",),
    "maps": ("maps.zarr",),
}
"""Names of the file of each part, the preferred name first."""
REMEDIES = {
    "fields": "`fields: {rate: 2}` in the scenario records fields; .pictures has planes of a recording",
    "pictures": "run without --no-recording; `export RUN --to pictures` converts recordings of earlier versions",
    "robots": "the scenario has no robots",
    "probes": "run with `probes: {points: [{kind: point, name: a, at: [1, 2]}]}` in the scenario",
    "forces": "this run computes no forces; a wind of kind cfd with obstacles does",
    "maps": "run with `maps: [{kind: time_series}]` or a group with a belief of the source, such as of kind infotaxis; "
    "they are written when a run ends",
}
"""Advice for each missing part."""


def open_run(folder: Path | str) -> "Run":
    """Open the results in a run's folder. Raises RunFolderError if there is no run, or one of another version.

    >>> import taichi_plume as tp
    >>> folder = tp.simulate("plumesim_casting", duration=1, out=folder).folder
    >>> tp.open_run(folder).robots.attrs["units"]["reading_ppm"]
    'ppm'
    """
    return Run(as_path(folder, "folder", RunFolderError))


class Run:
    """Results in the folder of a run, see `open_run`. Every attribute may raise RunFolderError.

    lenient: take a missing or damaged result as empty, and read other versions and changed files as far as possible.
    allow_outside: read obstacles' files outside the folder, even if they have changed. shapes: shapes of the
    obstacles, if known.
    """

    def __init__(
        self,
        folder: Path,
        lenient: bool = False,
        allow_outside: bool = False,
        shapes: "Sequence[Shape] | None" = None,
    ):
        self.folder, self.lenient, self.allow_outside = folder, lenient, allow_outside
        self._known_shapes = shapes
        fault = unopenable(folder, folder=True)
        if fault:
            raise RunFolderError(f"{folder}: {fault}; give the folder of a run")
        if not is_run(folder):
            raise RunFolderError(f"{folder}: is not the folder of a run")
        made = read_json(folder / "result.json").get("version", __version__)
        if not lenient and str(made).split(".")[:2] != __version__.split(".")[:2]:
            raise RunFolderError(
                f"{folder}: was made by taichi_plume {visible(made, LONGEST_TEXT)}, this is {__version__}; use that one"
            )

    @cached_property
    def result(self) -> dict[str, Any]:
        """Return the content of result.json: status, scores and diagnostics of the run."""
        path = self.folder / "result.json"
        content = read_json(path)
        if self.lenient:
            return content
        if not content.keys() >= OURS:
            raise RunFolderError(f"{path}: {'is damaged' if path.exists() else 'does not exist'}")
        manifest.require_unchanged(path, RunFolderError)
        return content

    @cached_property
    def trials(self) -> "pandas.DataFrame":
        """Table of outcomes with a row per trial and robot group, with units and meanings, from result.json."""
        import pyarrow as pa

        from taichi_plume.files.trials_table import TRIAL

        path, groups = self.folder / "result.json", self.result.get("groups")
        if not groups or self.result.get("status") == KILLED:  # a killed run has no outcomes of trials
            raise RunFolderError(f"{path}: has no trials: there are no robots, or the run has not ended")
        with _damage(path):
            trials = [{"algorithm": [g["algorithm"]] * g["trials"], **g["per_trial"]} for g in groups]
            fields = [field for field in TRIAL if field.name in trials[0]]
            values = [[value for group in trials for value in group[field.name]] for field in fields]
            arrays = [pa.array(each, field.type) for each, field in zip(values, fields, strict=True)]
            return data_frame(pa.table(arrays, pa.schema(fields)))

    @cached_property
    def scenario(self) -> "Scenario":
        """Return the scenario of the run with all defaults; files that the scenario names are not opened."""
        from taichi_plume.scenario.loading import ScenarioError, read_scenario

        path = self.folder / "scenario.yaml"
        if not self.lenient:
            manifest.require_unchanged(path, RunFolderError)
        try:
            return read_scenario(path)
        except ScenarioError as error:
            raise RunFolderError(f"{path}: is damaged, or of another version: {error.lines[0]}") from None

    @cached_property
    def fields(self) -> "xarray.Dataset":
        """Film of the run as a dataset: wind, gas and temperature at the cell centres over time."""
        return film_dataset(self._path("fields"))

    @cached_property
    def pictures(self) -> "xarray.Dataset":
        """Pictures of gas and temperature on planes over time, such as `gas_slice`, read on use.

        Attributes of each variable state its precision. The warm-up (t < 0) is included; pixels without air are NaN.
        `gas_column` is the maximum over the height. See files/pictures_file.py.
        """
        return pictures_file.read(self._path("pictures"))

    @cached_property
    def winds(self) -> "xarray.Dataset":
        """Wind [m/s] on a lattice of the recorded planes over time, such as `u_slice` and `v_slice`, read on use."""
        return pictures_file.read(self._path("pictures"), "wind")

    def output(self, name: str) -> "xarray.Dataset":
        """Return the pictures of one of the scenario's `outputs` over time, read on use."""
        path = self._path("pictures")
        if name not in (there := pictures_file.parts(path)):
            raise RunFolderError(f"{path}: has no output '{name}', but {', '.join(there) or 'none'}")
        return pictures_file.read(path, name)

    @cached_property
    def robots(self) -> "pandas.DataFrame":
        """Table with a row per robot and sampling time, up to the last data on the disk."""
        return _table(self._path("robots").with_name("robots.parquet"))

    @cached_property
    def probes(self) -> "pandas.DataFrame":
        """Table of the probes in the air with a row per point and sampling time, up to the last data on the disk."""
        return _table(self._path("probes").with_name("probes.parquet"))

    @cached_property
    def forces(self) -> "pandas.DataFrame":
        """Table of the force of the air on each obstacle [N] over time, up to the last complete row."""
        return _forces(self._path("forces"))

    @cached_property
    def maps(self) -> "list[xarray.Dataset]":
        """Gas maps at the end of the run, in the order of the scenario; see files/maps_file.py."""
        from taichi_plume.files import maps_file

        return maps_file.read(self._path("maps"))

    @cached_property
    def beliefs(self) -> "list[xarray.Dataset]":
        """Source-position posteriors at the end, a dataset per robot group that has one; see files/maps_file.py."""
        from taichi_plume.files import maps_file

        return maps_file.read_beliefs(self._path("maps"))

    def sources_at(self, t: "float | np.ndarray") -> "np.ndarray":
        """Return the true positions of all sources (..., m, dim) [m] at times t (...) [s].

        NaN for a source that has not started or has ended.
        """
        return self.scenario.sources_at(t)

    @property
    def status(self) -> str:
        """Status of the run, such as "completed"; "unknown" without result.json."""
        return str(self.result.get("status", "unknown"))

    @property
    def unfinished(self) -> bool:
        """Whether the run still runs or was killed, so that its files may end anywhere."""
        return self.status in ("running", KILLED, "unknown")

    @property
    def begin(self) -> float:
        """Simulated time at the start of the run [s]; negative with a warm-up."""
        return self.scenario.first_tick * self.scenario.tick

    @cached_property
    def header(self) -> list[str]:
        """Lines of the comment in scenario.yaml: the command to repeat the run, versions and seeds."""
        content = content_of(self.folder / "scenario.yaml", LARGEST_FILE, RunFolderError)
        lines = takewhile(lambda line: line.startswith("#"), content.decode(errors="replace").split("\n"))
        texts = [line.removeprefix(HEADER).removeprefix("#").strip() for line in lines]
        return [text.removeprefix("Again:").strip() for text in texts]

    @cached_property
    def tracks(self) -> "list[Track]":
        """Trajectories of robots in the first trial of each group, of at most MOST_ROBOTS in all."""
        from taichi_plume.results.tracks import tracks

        return tracks(self.folder / "robots.parquet", self.scenario.robots)

    @property
    def shapes(self) -> "Sequence[Shape]":
        """Shapes of the run's obstacles, without those whose files may not be read."""
        return self._shapes_and_lacks[0]

    @property
    def lacks(self) -> list[str]:
        """Sentences on each obstacle whose shape cannot be read, and on a missing or damaged result.json."""
        lacks = [] if self.result else ["result.json is missing or damaged: how the run ended is not known."]
        return lacks + self._shapes_and_lacks[1]

    @cached_property
    def _shapes_and_lacks(self) -> "tuple[Sequence[Shape], list[str]]":
        from taichi_plume.results.obstacles import shapes_of

        if self._known_shapes is not None:
            return self._known_shapes, []
        return shapes_of(self.folder, self.scenario, self.allow_outside)

    # ---------------------------------------------------------------- to look at

    def plot(
        self,
        at: float | None = None,
        view: str | None = None,
        of: str = "gas",
        wind: bool = True,
        *,
        ax: "Axes | None" = None,
        figsize: tuple[float, float] | None = None,
    ) -> "Figure":
        """Return a figure of the run at time `at` [s], by default the end: gas with its scale, wind and robots.

        view: "above", "column", "section" or a plane of the recording; by default column in 3-D. of: quantity, such as
        "temperature". ax: axes of a figure of yours to draw into, whose
        ``ax.legend()`` then names sources and robots; figsize: width and height of a new figure [inches]. Raises
        InputError if there is no such view or time, or the figure would be too small.
        """
        from taichi_plume.report.pictures import Shown, still
        from taichi_plume.report.theme import Place

        return still(self, at, Shown(view, of, None, wind), Place.of(ax, figsize))[0]

    def animate(
        self,
        path: Path | str | None = None,
        view: str | None = None,
        of: str = "gas",
        begin: float | None = None,
        end: float | None = None,
        fps: int = 12,
    ) -> "Film":
        """Return a film of the run from `begin` to `end` [s], which a notebook shows; with `path` also write it.

        path: file ending in .gif or, with ffmpeg, .mp4. view, of: as of `plot`. By default from the start of the robots
        to the end, with at most 150 frames. Raises InputError and OSError.
        """
        from taichi_plume.report.pictures import Film, Shown

        return Film.of(
            self, None if path is None else as_path(path, "path"), Shown(view, of), begin, end, fps
        )

    def show(self) -> object:
        """Show the recording in rerun's viewer: in a notebook within the page, else in a window of its own.

        In a notebook the extra `notebook` is needed. Raises RunFolderError if there is no recording or no viewer.
        """
        from taichi_plume.record.live import show

        self.require("recording.rrd")
        return show(self.folder / "recording.rrd")

    def gas_at(self, x: float, y: float, z: float | None = None) -> "xarray.Dataset":
        """Return the concentration of each gas over time [ppm] at a position [m]; see results/gas_at.py.

        It is interpolated from `fields` or, without these, from `pictures`. The attributes of each variable state its
        precision. Raises InputError if the position is outside the room or, for pictures, outside their planes.
        """
        from taichi_plume.results.gas_at import gas_at

        return gas_at(self, x, y, z)

    def _repr_html_(self) -> str:
        from taichi_plume.report.notebook import of_run

        return of_run(self)

    def has(self, name: str) -> bool:
        """Return whether the run's folder contains a file or folder of this name."""
        return (self.folder / name).exists()

    def require(self, name: str) -> None:
        """Raise RunFolderError, with advice, if the run's folder lacks `name`, fields.zarr or recording.rrd."""
        if not self.has(name):
            how = "`fields: {rate: 2}` in the scenario" if name == "fields.zarr" else "a recording"
            raise RunFolderError(f"{self.folder}: has no {name}; run with {how}")

    def _path(self, part: str) -> Path:
        """Return the existing file of a kind of result, such as "robots". Raises RunFolderError if there is none."""
        for name in FILES[part]:
            if self.has(name):
                return self.folder / name
        raise RunFolderError(f"{self.folder}: has no {FILES[part][0]}; {REMEDIES[part]}")

    def __repr__(self) -> str:
        content = read_json(self.folder / "result.json")
        status = content.get("status", "unknown")
        lines = [f"{self.folder}: {content.get('name', 'a run')}, {status}"]
        if isinstance(content.get("simulated_s"), int | float):
            lines[0] += f", {content['simulated_s']:g} s"
        for part, files in FILES.items():
            there = next(filter(self.has, files), None)
            lines.append(f"  {part:<8} {there or f'none: {REMEDIES[part]}'}")
        return "\n".join(visible(line) for line in [*lines, "  result", "  trials", "  scenario"])


@contextmanager
def _damage(path: Path) -> Iterator[None]:
    """Context that raises errors of parsing as a RunFolderError: the file is damaged."""
    try:
        yield
    except (ValueError, TypeError, LookupError, ArithmeticError) as error:
        raise RunFolderError(f"{path}: is damaged: {plain(' '.join(str(error).split()))}") from None


def film_dataset(path: Path) -> "xarray.Dataset":
    """Return the variables of a film (recorded wind and gas) at the cell centres. Raises RunFolderError if damaged."""
    from taichi_plume.files import zarr_groups
    from taichi_plume.files.film import Film

    film = Film(path)
    with zarr_groups.errors_as(RunFolderError, path):
        group = zarr_groups.Group(path, consolidated=True)  # the state of the last flush, which is complete
        for name in group.names:
            _ = group[name]
        data = zarr_groups.open_dataset(path, consolidated=True, chunks=None)
        for name in map(str, data.data_vars):
            stored, frames = zarr_groups.stored_chunks(film.arrays[name]), data[name].sizes.get("time", 1)
            if stored < frames:
                raise ValueError(f"{name} has {stored} of {frames} frames")
        if not {"time", "air"} <= data.variables.keys():
            raise ValueError("time or air is missing")
    ends = ("_face", "_ghost")
    others = [name for name in data.variables if any(d.endswith(ends) for d in data[name].dims)]
    return data.drop_vars([*others, "volume"])


def _table(path: Path) -> "pandas.DataFrame":
    """Return a Parquet table of the run as a DataFrame, with units and meanings of the columns in `attrs`."""
    from taichi_plume.files import run_tables

    table = run_tables.read(path)
    with _damage(path):
        return data_frame(table)


def data_frame(table: "pyarrow.Table") -> "pandas.DataFrame":
    """Return a pyarrow table as a DataFrame, with units and meanings of the columns in `attrs`."""
    from taichi_plume.files import run_tables

    frame = table.to_pandas()
    frame.attrs["units"] = run_tables.units(table.schema)
    frame.attrs["meanings"] = run_tables.meanings(table.schema)
    return frame


def _forces(path: Path) -> "pandas.DataFrame":
    """Return the complete rows of forces.csv as a DataFrame, with units taken from the column names."""
    import pandas

    manifest.require_unchanged(path, RunFolderError)
    content = content_of(path, LARGEST_CSV, RunFolderError)
    with _damage(path):
        frame = pandas.read_csv(io.BytesIO(content[: content.rfind(b"\n") + 1]))
        frame = frame.astype({name: int if name == "obstacle" else float for name in frame.columns})
        if list(frame.columns[:2]) != ["t_s", "obstacle"]:
            raise ValueError("the first line names other columns")
    frame.attrs["units"] = {name: name.partition("_")[2] or "1" for name in frame.columns}
    return frame
