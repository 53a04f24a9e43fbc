"""The formats that are read: a good file of each, and how a damaged one is read."""

import json
import shutil
import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from taichi_plume import __version__
from taichi_plume.files import manifest
from tests.files.refusals import unfinished
from tests.fuzz import bases
from tests.fuzz.watched import Outcome, tried

CSV = "t,x,y,reading,wind_x,wind_y,trial,group\n" + "".join(
    f"{0.5 * n},{0.1 * n:.3g},{1 + 0.05 * n:.3g},{(7 * n) % 40},{0.3},{-0.01 * n:.3g},{n % 2},{'ab'[n % 3 > 1]}\n"
    for n in range(60)
)


@dataclass(frozen=True)
class Format:
    """file: which of the base's files is damaged; scenario: the one that reads it, if any; part: of a run, that
    `open_run` reads; checked: whether the format has checksums, so that what is read has to be what was written; text:
    whether it is text.
    """

    file: str
    scenario: str = ""
    part: str = ""
    checked: bool = False
    text: bool = True


FORMATS = {
    "parquet": Format("robots.parquet", checked=True, text=False),
    "readings": Format("readings.csv"),
    "mcap": Format("bag.mcap", text=False),
    "sqlite_bag": Format("bag.db3", text=False),
    "bag_metadata": Format("bag/metadata.yaml"),
    "film": Format("fields.zarr", "film", checked=True, text=False),
    "plumesim_log": Format("short.pslog", "log"),
    "fluent": Format("plume002.txt", "fluent"),
    "netcdf": Format("movie.nc", "netcdf", text=False),
    "netcdf3": Format("movie3.nc", "netcdf3", text=False),
    "gaden_result": Format("result/iteration_1", "gaden_result", text=False),
    "paraview": Format("wind_2.csv", "imported"),
    "gaden_wind": Format("gaden_0.csv", "gaden"),
    "openfoam": Format("set/0/U.xy", "openfoam"),
    "occupancy": Format("occupancy.csv", "imported"),
    "map": Format("plan.yml", "map"),
    "stl": Format("box.stl", "mesh", text=False),
    "obj": Format("box.obj", "obj"),
    "ply": Format("box.ply", "ply"),
    "map_picture": Format("plan.pgm", "map", text=False),
    "prior": Format("prior.npy", "prior", text=False),
    "responses": Format("responses.csv", "responses"),
    "response_arrays": Format("responses.npz", "response_arrays", text=False),
    "run_film": Format("fields.zarr", part="fields", checked=True, text=False),
    "run_maps": Format("maps.zarr", part="maps", checked=True, text=False),
    "run_robots": Format("robots.parquet", part="robots", checked=True, text=False),
    "run_stream": Format("probes.arrows", part="probes", text=False),
    "run_forces": Format("forces.csv", part="forces"),
    "run_result": Format("result.json", part="result"),
    "yaml": Format("mixture.yaml", "mixture"),
}
SEARCH = """duration: 2
domain: {{size: [1, 1], spacing: 0.1}}
wind: {{kind: synthetic}}
gas: {{kind: eulerian, sources: [{{position: [0.3, 0.5], rate: 1 mg/s}}]}}
robots:
  - count: 1
    start: {{kind: positions, positions: [[0.8, 0.8]]}}
    algorithm: {{kind: infotaxis, {prior}}}
    sensors: {{gas: [{{kind: mox}}, {{kind: mox, model: tgs2611}}], {classifier}}}
"""
WIND = "wind: {kind: imported, files: wind_%d.csv, occupancy: occupancy.csv, interval: 0.5}"


def make(folder: Path) -> None:
    """Write a good file of each format, and the scenarios that read them."""
    bases.make(folder)
    (folder / "readings.csv").write_text(CSV)
    frames = [f"+{n + 1} 12\n" + "".join(_node(k, n) for k in range(12)) for n in range(6)]
    (folder / "short.pslog").write_text("500,6,0.2\n" + "".join(frames))
    text = bases.SCENARIOS["fluent"].partition("wind:")[0]
    log = "{kind: plumesim_log, file: short.pslog"
    (folder / "log.yaml").write_text(f"{text}wind: {log}}}\ngas: {log}, interpolate: true}}\n")
    imported = bases.SCENARIOS["imported"]
    rows = (folder / "wind_0.csv").read_text().splitlines()[1:]
    (folder / "gaden_0.csv").write_text("\n".join(["U_0,U_1,U_2,Points_0,Points_1,Points_2", *rows]) + "\n")
    gaden = "wind: {kind: imported, files: gaden_%d.csv, occupancy: occupancy.csv}"
    (folder / "gaden.yaml").write_text(imported.replace(WIND, gaden))
    points = [row.split(",")[3:] + row.split(",")[:3] for row in rows]
    for time in (0, 1):
        (folder / f"set/{time}").mkdir(parents=True, exist_ok=True)
        lines = ["# x y z Ux Uy Uz", *("  ".join(point) for point in points)]
        (folder / f"set/{time}/U.xy").write_text("\n".join(lines) + "\n")
    (folder / "openfoam.yaml").write_text(
        imported.replace(WIND, "wind: {kind: imported, files: set/%g/U.xy}")
    )
    plan = bases.SCENARIOS["mesh"].replace(
        "{kind: mesh, file: box.stl, section: 0.1}", "{kind: map, file: plan.yml}"
    )
    (folder / "map.yaml").write_text(plan)
    for kind in ("obj", "ply"):
        (folder / f"{kind}.yaml").write_text(bases.SCENARIOS["mesh"].replace("box.stl", f"box.{kind}"))
    _write_table(folder / "robots.parquet")
    shutil.copy(folder / "robots.parquet", folder / "probes.parquet")
    unfinished(folder / "probes.parquet", rows=1000)
    (folder / "forces.csv").write_text(
        "t_s,obstacle,x_N,y_N\n" + "".join(f"{n},0,{0.1 * n},-1e-3\n" for n in range(9))
    )
    (folder / "result.json").write_text(
        json.dumps({"name": "a", "status": "completed", "seed": 1, "version": __version__})
    )
    np.save(folder / "movie.npy", np.random.default_rng(2).random((6, 20, 30)))
    _write_movies(folder, text)
    _write_guesses(folder)
    _write_maps(folder / "maps.zarr")
    manifest.write(folder, {}, [folder / name for name in ("robots.parquet", "fields.zarr", "maps.zarr")])


def _node(k: int, n: int) -> str:
    return f"{0.1 + 0.1 * (k % 4):.3g},{0.1 + 0.1 * (k // 4):.3g},0,{0.1 * n:.3g},{0.3 * k:.3g},{2 * k + n}\n"


def _write_table(path: Path) -> None:
    """robots.parquet as runs leave it."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    rng, n = np.random.default_rng(1), np.arange(3000)
    names = ("x", "y", "heading", "believed_x", "believed_y", "reading_ppm", "wind_x", "wind_y")
    table = {
        "t": n // 6 * 0.1 + 0.1,
        "group": pa.DictionaryArray.from_arrays(
            pa.array((n % 2).astype(np.int32)), pa.array(["red", "blue"])
        ),
        "trial": (n % 3).astype(np.int32),
        **{name: rng.normal(2.0, 0.5, len(n)).astype(np.float32) for name in names},
    }
    pq.write_table(pa.table(table), path, compression="zstd", write_page_checksum=True, row_group_size=1000)


def _write_guesses(folder: Path) -> None:
    """A prior of the source and tables of responses to gases, a network that classifies, and what reads them."""
    from onnx import TensorProto, helper

    np.save(folder / "prior.npy", np.random.default_rng(3).random((8, 9)))
    rows = [("ethanol", 0.2, 0.8), ("ethanol", 0.1, 0.7), ("methane", 0.9, 0.4), ("air", 1.0, 1.0)]
    (folder / "responses.csv").write_text(
        "gas,first,second\n" + "".join(f"{g},{a},{b}\n" for g, a, b in rows)
    )
    np.savez(folder / "responses.npz", gas=[row[0] for row in rows], responses=[row[1:] for row in rows])
    ends = [helper.make_tensor_value_info(name, TensorProto.FLOAT, ["rows", 2]) for name in "xp"]
    graph = helper.make_graph([helper.make_node("Softmax", ["x"], ["p"], axis=1)], "g", ends[:1], ends[1:])
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)], ir_version=8)
    (folder / "gases.onnx").write_bytes(model.SerializeToString())
    (folder / "prior.yaml").write_text(SEARCH.format(prior="prior: {file: prior.npy}", classifier=""))
    for name, file in (("responses", "responses.csv"), ("response_arrays", "responses.npz")):
        classifier = f"classifier: {{kind: nearest, file: {file}, follows: ethanol, neighbours: 1}}"
        (folder / f"{name}.yaml").write_text(SEARCH.format(prior="", classifier=classifier))


def _write_movies(folder: Path, text: str) -> None:
    """Movies that xarray writes, a result of GADEN, and the scenarios that play them."""
    import xarray

    axes = {"time": np.arange(4) / 2, "y": 0.05 + 0.1 * np.arange(5)[::-1], "x": 0.05 + 0.1 * np.arange(6)}
    values = np.random.default_rng(2).random((4, 5, 6))
    data = xarray.Dataset({"gas": (tuple(axes), values, {"units": "ppm"})}, axes)
    packing = {"gas": {"dtype": "i2", "scale_factor": 0.001, "_FillValue": -1}}
    data.to_netcdf(folder / "movie.nc", engine="h5netcdf", encoding=packing)
    data.to_netcdf(folder / "movie3.nc", engine="scipy", encoding=packing)
    for name in ("movie.nc", "movie3.nc"):
        played = f"wind: {{kind: uniform, velocity: [0.1, 0]}}\ngas: {{kind: movie, file: {name}}}\n"
        (folder / {"movie.nc": "netcdf.yaml", "movie3.nc": "netcdf3.yaml"}[name]).write_text(text + played)
    (folder / "result").mkdir(exist_ok=True)
    for n in range(2):
        head = struct.pack("<i6d3i3d3d", 1, 0, 0, 0, 0.6, 0.5, 0.2, 6, 5, 2, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1)
        filaments = [struct.pack("<i4d", k, 0.1 + 0.1 * k, 0.2, 0.1, 5.0 + n) for k in range(5)]
        body = head + struct.pack("<i2di", 0, 1e-8, 4.1e-5, 0) + b"".join(filaments)
        (folder / f"result/iteration_{n}").write_bytes(zlib.compress(body))
    gas = "gas: {kind: gaden, files: result/iteration_%d}"
    (folder / "gaden_result.yaml").write_text(f"{text}wind: {{kind: uniform, velocity: [0.1, 0]}}\n{gas}\n")


def _write_maps(path: Path) -> None:
    """A map of two trials as a run leaves it."""
    from taichi_plume.execution.maps_output import MapsFile
    from taichi_plume.scenario.maps import TimeSeriesMap

    values = np.random.default_rng(2).random((2, 6, 5))
    series = SimpleNamespace(
        map=SimpleNamespace(estimate=lambda: values, weight=lambda: 2 * values),
        truth=values[0],
        measurable=values[0] > 0.1,
        cell=0.25,
        quantity="gas",
        levels=None,
        parts=[slice(0, 2)],
    )
    maps = [TimeSeriesMap(kind="time_series")]
    scenario = SimpleNamespace(name="a", seeds={"seed": 1}, backgrounds={}, maps=maps)
    sim: Any = SimpleNamespace(scenario=scenario, swarm=SimpleNamespace(count=0), teams=(), t=5.0)
    shutil.rmtree(path, ignore_errors=True)
    writer = MapsFile(sim, path, SimpleNamespace(series=[series]))  # type: ignore[arg-type]
    writer.start()
    writer.close()


# ---------------------------------------------------------------- reading


class Reader:
    """Reads damaged files (name of the format, content or None for what lies there); the folder is that of `make`."""

    def __init__(self, folder: Path):
        self.folder = folder
        self.read = {}
        for name, kind in FORMATS.items():
            values, errors = (_run if kind.part else _scenario if kind.scenario else _readings)(folder, kind)
            self.read[name] = (values, errors, _facts(values()))

    def __call__(self, job: tuple[str, bytes | None]) -> Outcome:
        """The outcome."""
        name, content = job
        read, errors, good = self.read[name]
        if content is not None:
            (self.folder / FORMATS[name].file).write_bytes(content)

        def call() -> Outcome:
            found = _facts(read())
            if FORMATS[name].checked and found != good:
                return Outcome("silent", "what was read is not what was written", name)
            return Outcome("accepted")

        return tried(call, errors)


def _facts(value: Any) -> Any:
    """What can be compared of what was read."""
    if isinstance(value, dict):
        return {key: _facts(part) for key, part in value.items()}
    if isinstance(value, (list, tuple)):
        return [_facts(part) for part in value]
    return (value.dtype, value.shape, value.tobytes()) if isinstance(value, np.ndarray) else value


def _readings(folder: Path, kind: Format) -> tuple[Callable[[], Any], tuple]:
    from taichi_plume.files.readings import ReadingsError, read

    path = folder / kind.file

    def values() -> Any:
        readings = read(path.parent if path.name == "metadata.yaml" else path)
        return [readings.t, readings.place, readings.reading, readings.wind, readings.row]

    return values, (ReadingsError,)


def _run(folder: Path, kind: Format) -> tuple[Callable[[], Any], tuple]:
    from taichi_plume import open_run
    from taichi_plume.files.run_folder import RunFolderError
    from taichi_plume.results.export import frames

    def values() -> Any:
        part = getattr(open_run(folder), kind.part)
        if kind.part == "result":
            return part
        if kind.part == "maps":
            return [[one.attrs, {name: one[name].values for name in map(str, one.variables)}] for one in part]
        if kind.part == "fields":
            read = frames(part, folder)
            return [part.attrs, [[read(name, n) for n in range(3)] for name in map(str, part.variables)]]
        return [part.attrs, {name: part[name].to_numpy().astype(str) for name in part.columns}]

    return values, (RunFolderError,)


def _scenario(folder: Path, kind: Format) -> tuple[Callable[[], Any], tuple]:
    from taichi_plume.assembly.preparation import load
    from taichi_plume.files.film import FilmError
    from taichi_plume.files.wind_points import WindFileError
    from taichi_plume.grid.floor_plans import FloorPlan
    from taichi_plume.scenario.loading import ScenarioError

    def values() -> Any:
        _, resources = load(folder / f"{kind.scenario}.yaml")
        found: list[Any] = []
        for film in {film.path: film for film in resources.films.values()}.values():
            names = [*film.wind, *film.gas]
            found += [film.frame(n, names) for n in range(len(film.times))]
            found += [
                film.still(name)
                for name in sorted(film.arrays)
                if name.startswith(("open_", "area_", "volume"))
            ]
            found += [film.times, film.attributes, film.shape, film.dx, film.air().volume]
        for film in (*resources.movies.values(), *resources.gaden_films.values()):
            found += [film.frame(n, ["gas"]) for n in range(len(film.times))]
        found += [one.rectangles(1000) for one in resources.obstacles if isinstance(one, FloorPlan)]
        if resources.site:
            found += [resources.site.read(file).velocity for _, file in resources.site.files]
            resources.site_air()
        return found

    return values, (ScenarioError, FilmError, WindFileError)
