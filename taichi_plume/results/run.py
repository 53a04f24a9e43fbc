"""What a run has left, for notebooks and plots: ``run = taichi_plume.open_run("runs/casting_room-1")``.

    run.fields      xarray.Dataset: wind, gas [ppm] and temperature over time, of a run with `fields` in its scenario;
                    values are read when they are used
    run.pictures    xarray.Dataset: planes decoded from the colours of the recording; see `Run.pictures`
    run.robots      pandas.DataFrame: a row per robot and tick; units in `run.robots.attrs["units"]`
    run.probes      pandas.DataFrame, of a run with `probes`
    run.forces      pandas.DataFrame: the force of the air on each obstacle
    run.maps        list of xarray.Dataset: each gas map at the end, beside the truth
    run.beliefs     list of xarray.Dataset: where each group believed the source to be, at the end
    run.result      dict: what came of the run
    run.trials      pandas.DataFrame: a row per trial of each group, of a run that has ended
    run.scenario    Scenario: with every default

Opening is instant, each part is read when it is first asked for. Of a run that still runs, or was killed, there is what
has come to the disk. What is missing or damaged is told in one line, as a RunFolderError.

Reports, pictures and films also use

    run.planes      results.planes.Planes: pictures and wind arrows in planes, of the recording or the fields
    run.tracks      list of results.tracks.Track: robots of the first trial of each group over time
    run.shapes      shapes of the obstacles, as far as they may be read; `run.lacks` says which may not
"""

import io
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from taichi_plume import __version__
from taichi_plume.files import manifest
from taichi_plume.files.run_folder import HEADER, KILLED, OURS, RunFolderError, is_run, told
from taichi_plume.files.tables import LONGEST_TEXT, plain
from taichi_plume.guard.opening import read_regular, unopenable
from taichi_plume.guard.terminal import visible

if TYPE_CHECKING:
    import pandas
    import xarray

    from taichi_plume.grid.shapes import Shape
    from taichi_plume.results.planes import Planes
    from taichi_plume.results.tracks import Track
    from taichi_plume.scenario.scenario import Scenario

LARGEST_CSV = 1 << 30  # bytes
FILES = {
    "fields": ("fields.zarr",),
    "pictures": ("recording.rrd",),
    "robots": ("robots.parquet", "robots.parts"),
    "probes": ("probes.parquet", "probes.parts"),
    "forces": ("forces.csv",),
    "maps": ("maps.zarr",),
}
"""Where each part may be, the best first."""
WANTED = {
    "fields": "`fields: {rate: 2}` in the scenario records fields (.pictures are the colours of a recording, decoded)",
    "pictures": "run without --no-recording",
    "robots": "the scenario has no robots",
    "probes": "run with `probes: {points: [{kind: point, name: a, at: [1, 2]}]}` in the scenario",
    "forces": "the air of this run tells no forces; a wind of kind cfd with obstacles does",
    "maps": "run with `maps: [{kind: time_series}]` or a group that believes in places of the source, such as of kind "
    "infotaxis; they are written when a run ends",
}
"""How to get what is not there."""


def open_run(folder: Path | str) -> "Run":
    """The run of a folder. Raises RunFolderError, in one line, where it is none or of another version."""
    return Run(Path(folder))


class Run:
    """The folder of a run, see `open_run`. Every attribute may raise RunFolderError.

    lenient: a result that is missing or damaged is an empty one, and other versions and changed files are read as far
    as they can be. allow_outside: the files of obstacles may lie outside the folder and be others than the run has
    read. shapes: of the obstacles, if they are known.
    """

    def __init__(
        self,
        folder: Path,
        lenient: bool = False,
        allow_outside: bool = False,
        shapes: "Sequence[Shape] | None" = None,
    ):
        self.folder, self.lenient, self.allow_outside, self._known_shapes = (
            folder,
            lenient,
            allow_outside,
            shapes,
        )
        fault = unopenable(folder, folder=True)
        if fault:
            raise RunFolderError(f"{folder}: {fault}; give the folder of a run")
        if not is_run(folder):
            raise RunFolderError(f"{folder}: is not the folder of a run")
        made = told(folder / "result.json").get("version", __version__)
        if not lenient and str(made).split(".")[:2] != __version__.split(".")[:2]:
            of = visible(made, LONGEST_TEXT)
            raise RunFolderError(
                f"{folder}: was made by taichi_plume {of}, this is {__version__}; use that one"
            )

    @cached_property
    def result(self) -> dict[str, Any]:
        """What came of the run: result.json."""
        path = self.folder / "result.json"
        content = told(path)
        if self.lenient:
            return content
        if not content.keys() >= OURS:
            raise RunFolderError(f"{path}: {'is damaged' if path.exists() else 'does not exist'}")
        _require_same(path)
        return content

    @cached_property
    def trials(self) -> "pandas.DataFrame":
        """A row per trial of each group, named by `group`: what its result tells, with units and meanings."""
        import pyarrow as pa

        from taichi_plume.files.trials_table import TRIAL

        path, groups = self.folder / "result.json", self.result.get("groups")
        if (
            not groups or self.result.get("status") == KILLED
        ):  # a killed run tells how far the robots came, at most
            raise RunFolderError(
                f"{path}: tells of no trials: the scenario has no robots, or the run has not ended"
            )
        try:
            told = [{"algorithm": [one["algorithm"]] * one["trials"], **one["per_trial"]} for one in groups]
            fields = [one for one in TRIAL if one.name in told[0]]
            values = [[value for one in told for value in one[field.name]] for field in fields]
            arrays = [pa.array(each, field.type) for each, field in zip(values, fields, strict=True)]
            return _frame(pa.table(arrays, pa.schema(fields)))
        except (LookupError, TypeError, ValueError) as error:
            raise RunFolderError(f"{path}: is damaged: {plain(' '.join(str(error).split()))}") from None

    @cached_property
    def scenario(self) -> "Scenario":
        """The scenario with every default; the files that it names are not opened."""
        from taichi_plume.scenario.loading import ScenarioError, read_scenario

        path = self.folder / "scenario.yaml"
        if not self.lenient:
            _require_same(path)
        try:
            return read_scenario(path)
        except ScenarioError as error:
            raise RunFolderError(f"{path}: is damaged, or of another version: {error.lines[0]}") from None

    @cached_property
    def fields(self) -> "xarray.Dataset":
        """Wind, gas and temperature at the cells' middles, over time, as `fields` in the scenario recorded them.

        Raises RunFolderError if the scenario has no `fields`.
        """
        return _film(self._path("fields"))

    @cached_property
    def pictures(self) -> "xarray.Dataset":
        """Planes of gas and temperature over time, decoded from the colours of the recording.

        They are to look at, not to measure: a picture has 256 colours between `recorded_from` and `recorded_to`
        (attributes of each variable). A higher value comes back as `recorded_to`; on a logarithmic scale, a lower value
        comes back as 0. The variables are planes, such as `gas_slice` and `gas_column` (maximum over the height), and
        include the times of the warm-up (t < 0). `fields` in the scenario records the values themselves.
        """
        from taichi_plume.record.reading import pictures

        self.require("recording.rrd")
        return pictures(self.folder / "recording.rrd")

    @cached_property
    def robots(self) -> "pandas.DataFrame":
        """A row per robot and tick, as far as the run has come."""
        return _table(self._path("robots").with_name("robots.parquet"))

    @cached_property
    def probes(self) -> "pandas.DataFrame":
        """A row per point and sample, as far as the run has come."""
        return _table(self._path("probes").with_name("probes.parquet"))

    @cached_property
    def forces(self) -> "pandas.DataFrame":
        """The force of the air on each obstacle [N]; of a run that was killed up to its last whole row."""
        return _rows(self._path("forces"))

    @cached_property
    def maps(self) -> "list[xarray.Dataset]":
        """The gas maps at the end, in the order of the scenario; see files/maps_file.py."""
        from taichi_plume.files import maps_file

        return maps_file.read(self._path("maps"))

    @cached_property
    def beliefs(self) -> "list[xarray.Dataset]":
        """What each group that believes in places of the source believed at the end; see files/maps_file.py."""
        from taichi_plume.files import maps_file

        return maps_file.read_beliefs(self._path("maps"))

    # ------------------------------------------------------------ for reports, pictures and films

    @property
    def status(self) -> str:
        """How the run ended, in a word: "unknown" if result.json does not say."""
        return str(self.result.get("status", "unknown"))

    @property
    def unfinished(self) -> bool:
        """Whether the run still runs or was killed: its files may end anywhere."""
        return self.status in ("running", KILLED, "unknown")

    @property
    def begin(self) -> float:
        """Simulated time of the first tick [s]."""
        return self.scenario.first_tick * self.scenario.tick

    @cached_property
    def header(self) -> list[str]:
        """The lines above scenario.yaml: the command to run the scenario again, then what the run ran with."""
        lines = []
        with (self.folder / "scenario.yaml").open(encoding="utf-8", errors="replace") as file:
            for line in file:
                if not line.startswith("#"):
                    break
                lines.append(
                    line.removeprefix(HEADER).removeprefix("#").strip().removeprefix("Again:").strip()
                )
        return lines

    @cached_property
    def planes(self) -> "Planes":
        """Pictures and wind arrows in planes."""
        from taichi_plume.results.planes import Planes

        return Planes(self.folder, self.scenario)

    @cached_property
    def tracks(self) -> "list[Track]":
        """Robots of the first trial of each group over time, as many as can be told apart."""
        from taichi_plume.results.tracks import tracks

        return tracks(self.folder / "robots.parquet", self.scenario.robots)

    @property
    def shapes(self) -> "Sequence[Shape]":
        """Shapes of the obstacles, as far as they may be read."""
        return self._shapes_and_lacks[0]

    @property
    def lacks(self) -> list[str]:
        """A sentence on each obstacle that is not among the shapes, and on a missing result."""
        lacks = [] if self.result else ["result.json is missing or damaged: how the run ended is not known."]
        return lacks + self._shapes_and_lacks[1]

    @cached_property
    def _shapes_and_lacks(self) -> "tuple[Sequence[Shape], list[str]]":
        from taichi_plume.results.obstacles import shapes_of

        if self._known_shapes is not None:
            return self._known_shapes, []
        return shapes_of(self.folder, self.scenario, self.allow_outside)

    def require(self, name: str) -> None:
        """Raises RunFolderError where the run has no film or recording, whichever is named."""
        if not (self.folder / name).exists():
            how = "`fields: {rate: 2}` in the scenario" if name == "fields.zarr" else "a recording"
            raise RunFolderError(f"{self.folder}: has no {name}; run with {how}")

    def _path(self, part: str) -> Path:
        """The file of a part that there is. Raises RunFolderError."""
        for name in FILES[part]:
            if (self.folder / name).exists():
                return self.folder / name
        raise RunFolderError(f"{self.folder}: has no {FILES[part][0]}; {WANTED[part]}")

    def __repr__(self) -> str:
        content = told(self.folder / "result.json")
        status = content.get("status", "of which nothing is told")
        lines = [f"{self.folder}: {content.get('name', 'a run')}, {status}"]
        if isinstance(content.get("simulated_s"), int | float):
            lines[0] += f", {content['simulated_s']:g} s"
        for part, files in FILES.items():
            there = next((name for name in files if (self.folder / name).exists()), None)
            lines.append(f"  {part:<8} {there or f'none: {WANTED[part]}'}")
        return "\n".join(visible(line) for line in [*lines, "  result", "  trials", "  scenario"])


def _require_same(path: Path) -> None:
    damage = manifest.changed(path)
    if damage:
        raise RunFolderError(damage)


def _film(path: Path) -> "xarray.Dataset":
    """What of a film is at the cells' middles."""
    from taichi_plume.files import zarr_groups
    from taichi_plume.files.film import Film, FilmError

    try:
        film = Film(path)
    except FilmError as error:
        raise RunFolderError(str(error)) from None
    try:
        group = zarr_groups.Group(path, consolidated=True)  # as it was when it was last consolidated, whole
        for name in group.names:
            _ = group[name]
        data = zarr_groups.open_dataset(path, consolidated=True, chunks=None)
        for name in map(str, data.data_vars):
            stored, wanted = zarr_groups.stored_chunks(film.arrays[name]), data[name].sizes.get("time", 1)
            if stored < wanted:
                raise ValueError(f"{name} has {stored} of {wanted} frames")
        if not {"time", "air"} <= data.variables.keys():
            raise ValueError("time or air is missing")
    except zarr_groups.GroupError as error:
        raise RunFolderError(str(error)) from None
    except zarr_groups.FAULTS as error:
        raise RunFolderError(f"{path}: is damaged: {zarr_groups.reason(error)}") from None
    beside = [
        name for name in data.variables if any(d.endswith(("_face", "_ghost")) for d in data[name].dims)
    ]
    return data.drop_vars([*beside, "volume"])


def _table(path: Path) -> "pandas.DataFrame":
    """A table of ours as pandas has them, with units and meanings."""
    from taichi_plume.files import table_parts

    table = table_parts.read(path)
    try:
        return _frame(table)
    except (ValueError, TypeError, LookupError) as error:
        raise RunFolderError(f"{path}: is damaged: {plain(' '.join(str(error).split()))}") from None


def _frame(table: Any) -> "pandas.DataFrame":
    """Return a table of pyarrow as pandas has them, with units and meanings."""
    from taichi_plume.files import table_parts

    frame = table.to_pandas()
    frame.attrs["units"] = table_parts.units(table.schema)
    frame.attrs["meanings"] = table_parts.meanings(table.schema)
    return frame


def _rows(path: Path) -> "pandas.DataFrame":
    """The whole rows of a CSV of ours, of which each name ends in its unit."""
    import pandas

    _require_same(path)
    try:
        content = read_regular(path, LARGEST_CSV)
    except OSError as error:
        raise RunFolderError(f"{path}: cannot be read: {error.strerror or error}") from None
    if content is None:
        raise RunFolderError(f"{path}: is too large; {LARGEST_CSV >> 20} MiB are read")
    try:
        frame = pandas.read_csv(io.BytesIO(content[: content.rfind(b"\n") + 1]))
        frame = frame.astype({name: int if name == "obstacle" else float for name in frame.columns})
        if list(frame.columns[:2]) != ["t_s", "obstacle"]:
            raise ValueError("its first line names other columns")
    except (ValueError, TypeError, ArithmeticError) as error:
        raise RunFolderError(f"{path}: is damaged: {plain(' '.join(str(error).split()))}") from None
    frame.attrs["units"] = {name: name.partition("_")[2] or "1" for name in frame.columns}
    return frame
