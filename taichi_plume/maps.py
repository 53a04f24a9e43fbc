"""Gas maps of recorded readings: ``python -m taichi_plume.maps READINGS --kind time_series --size 4 3 --out DIR``.

READINGS is the robots.parquet of a run, or a CSV file with the columns t [s], x, y [m] and reading [ppm], and where the
map uses it wind_x, wind_y [m/s]; where there are several trials, --trial chooses one. Parameters of the map have their
names in a scenario: --cell 0.25 --alpha 0.9. The readings go through the very maps that robots make online. In DIR:

    map.csv      x, y [m] of each cell's middle, ppm, weight and, where the map tells it, variance_ppm2
    map.png      the same, seen from above
    scores.json  forecast_error_ppm (eq 8 of Marjovi & Marques) of maps that forecast; nlpd of maps with a variance, of
                 the readings of each PERIOD before they are taken in; the peak
"""

import argparse
import json
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from taichi_plume.map_models import Map

COLUMNS = {
    "t": ("t",),
    "x": ("believed_x", "x"),
    "y": ("believed_y", "y"),
    "reading": ("reading_ppm", "reading"),
    "wind_x": ("wind_x",),
    "wind_y": ("wind_y",),
    "heading": ("heading",),
    "believed_heading": ("believed_heading",),
}
"""Of which names the first that a file has is taken."""
NEEDED = 4
FILES = ("map.csv", "map.png", "scores.json")
PERIOD = 5.0  # s


class ReadingsError(ValueError):
    """Readings or parameters that no map can be made of; the message is one line."""


@dataclass(frozen=True)
class Readings:
    """In order of time: t (n,) [s], place (n, 2) [m], reading (n,) [ppm], wind (n, 2) [m/s], zero if unknown."""

    t: np.ndarray
    place: np.ndarray
    reading: np.ndarray
    wind: np.ndarray


@dataclass(frozen=True)
class GasMap:
    """A finished map: estimate [ppm], weight and variance [ppm²] or None, (nx, ny), with cells of `cell` [m]."""

    cell: float
    estimate: np.ndarray
    weight: np.ndarray
    variance: np.ndarray | None
    scores: dict[str, Any]


# ---------------------------------------------------------------- from Python


def read(path: Path, trial: int = 0) -> Readings:
    """Readings of a file (see above). Raises ReadingsError."""
    import pyarrow as pa
    import pyarrow.compute as pc
    import pyarrow.csv
    import pyarrow.parquet as pq

    try:
        table = pq.read_table(path) if path.suffix == ".parquet" else pa.csv.read_csv(path)
    except (pa.ArrowException, OSError) as error:
        reason = getattr(error, "strerror", None) or str(error).splitlines()[0]
        raise ReadingsError(f"{path}: cannot be read: {reason}") from None
    if "trial" in table.column_names:
        table = table.filter(pc.equal(table["trial"], trial))
        if not table.num_rows:
            raise ReadingsError(f"{path}: has no trial {trial}")
    columns = {name: _column(path, table, names) for name, names in COLUMNS.items()}
    missing = [name for name in list(COLUMNS)[:NEEDED] if columns[name] is None]
    if missing:
        has = ", ".join(table.column_names)
        raise ReadingsError(f"{path}: has no column {', '.join(missing)}; it has {has}")
    n = table.num_rows
    t, x, y, reading, u, v, heading, believed = (
        np.zeros(n) if one is None else one for one in columns.values()
    )
    for name, values in (("t", t), ("x", x), ("y", y)):
        if not np.isfinite(values).all():
            row = int(np.flatnonzero(~np.isfinite(values))[0])
            raise ReadingsError(f"{path}: {name} of row {row + 1} is not a number")
    off = believed - heading  # robots take the wind for turned by it
    wind = np.column_stack([u * np.cos(off) - v * np.sin(off), u * np.sin(off) + v * np.cos(off)])
    kept = t > 0.0 if path.suffix == ".parquet" else np.ones(n, bool)  # at 0 s nothing has been measured yet
    if not kept.any():
        raise ReadingsError(f"{path}: has no readings")
    order = np.flatnonzero(kept)[np.argsort(t[kept], kind="stable")]
    return Readings(t[order], np.column_stack([x, y])[order], reading[order], np.nan_to_num(wind)[order])


def _column(path: Path, table: Any, names: tuple[str, ...]) -> np.ndarray | None:
    name = next((name for name in names if name in table.column_names), None)
    if name is None:
        return None
    try:
        return table[name].cast("float64").to_numpy()
    except Exception:  # Arrow tells of a cast in many ways
        raise ReadingsError(f"{path}: column {name} is not of numbers") from None


def map_of(
    readings: Readings, model: "Map", size: tuple[float, float], sources: np.ndarray | None = None
) -> GasMap:
    """The map of readings on a floor of this size [m]; Taichi must have been started. sources: (m, 2) [m], if known.

    Snaps are cut at multiples of their window since the time 0; those before the first reading are left out.
    Raises ReadingsError where no reading lies on the floor.
    """
    from taichi_plume.agents.recorded import RecordedTeam
    from taichi_plume.assemble import mappers
    from taichi_plume.scores import peak_distance, surprise

    told = np.isfinite(readings.reading)
    on = ((readings.place >= 0.0) & (readings.place <= size)).all(axis=1)
    if not (on & told).any():
        raise ReadingsError(f"no reading lies on the floor of {size[0]:g} x {size[1]:g} m from the origin on")
    gas_map: Any = mappers([model], size, 1, lambda points: np.full(np.shape(points)[:-1], np.inf))[0]
    window = float(getattr(gas_map, "window", PERIOD))
    begin = window * np.floor((readings.t[0] - 1e-9) / window)
    times, starts = np.unique(readings.t, return_index=True)
    ends = np.append(starts[1:], len(readings.t))
    dt = float(np.diff(times).min()) if len(times) > 1 else window
    team = RecordedTeam(int((ends - starts).max()))
    shape, knows = np.shape(gas_map.estimate())[1:], hasattr(gas_map, "variance")
    cells = np.clip((readings.place / gas_map.cell).astype(int), 0, np.array(shape) - 1)
    forecast, period, nlpd = None, 0, []
    for time, first, last in zip(times - begin, starts, ends, strict=True):
        if knows and int((time - 1e-9) / window) > period:
            forecast, period = (gas_map.estimate()[0], gas_map.variance()[0]), int((time - 1e-9) / window)
        rows = slice(int(first), int(last))
        if forecast:
            at = cells[rows][:, 0], cells[rows][:, 1]
            found = surprise(readings.reading[rows], forecast[0][at], forecast[1][at])
            nlpd += found[on[rows] & np.isfinite(found)].tolist()
        team.show(readings.place[rows], readings.wind[rows], readings.reading[rows])
        gas_map.update(team, float(time), dt)
    estimate, weight = np.asarray(gas_map.estimate()), np.asarray(gas_map.weight())
    errors = [(float(t + begin), float(error[0])) for t, error in gas_map.errors]
    counted = [error for _, error in errors if isfinite(error)]
    peak = _peak(estimate[0], gas_map.cell)
    if sources is not None:
        peak["to_source_m"] = float(peak_distance(estimate, gas_map.cell, sources)[0])
    scores = {
        "kind": model.kind,
        "readings": int((on & told).sum()),
        "left_out": int((~(on & told)).sum()),
        "known_fraction": float(np.isfinite(estimate).mean()),
        "peak": peak,
        "forecast_error_ppm": float(np.mean(counted)) if counted else None,
        "forecast": {"time_s": [t for t, _ in errors], "error_ppm": [error for _, error in errors]},
        "nlpd": float(np.mean(nlpd)) if nlpd else None,
        "nlpd_median": float(np.median(nlpd)) if nlpd else None,
    }
    variance = np.asarray(gas_map.variance())[0] if knows else None
    return GasMap(gas_map.cell, estimate[0], weight[0], variance, scores)


def _peak(estimate: np.ndarray, cell: float) -> dict[str, float | None]:
    """Where the largest estimate is [m], and how large [ppm]; None where the map knows nothing."""
    if not np.isfinite(estimate).any():
        return {"x_m": None, "y_m": None, "ppm": None}
    i, j = np.unravel_index(np.nanargmax(estimate), estimate.shape)
    return {"x_m": (float(i) + 0.5) * cell, "y_m": (float(j) + 0.5) * cell, "ppm": float(estimate[i, j])}


def write(gas_map: GasMap, readings: Readings, size: tuple[float, float], folder: Path) -> None:
    """Write FILES into an existing folder."""
    from taichi_plume.results import plain

    nx, ny = gas_map.estimate.shape
    i, j = np.meshgrid(np.arange(nx), np.arange(ny), indexing="ij")
    columns = {
        "x": (i + 0.5) * gas_map.cell,
        "y": (j + 0.5) * gas_map.cell,
        "ppm": gas_map.estimate,
        "weight": gas_map.weight,
    }
    if gas_map.variance is not None:
        columns["variance_ppm2"] = gas_map.variance
    table = np.column_stack([values.ravel() for values in columns.values()])
    np.savetxt(folder / FILES[0], table, "%.7g", ",", header=",".join(columns), comments="")
    _draw(gas_map, readings, size, folder / FILES[1])
    text = json.dumps(plain(gas_map.scores), indent=2, allow_nan=False) + "\n"
    (folder / FILES[2]).write_text(text, encoding="utf-8")


def _draw(gas_map: GasMap, readings: Readings, size: tuple[float, float], path: Path) -> None:
    from matplotlib.figure import Figure

    pictures = {"estimate [ppm]": gas_map.estimate, "weight, as power of ten": _log(gas_map.weight)}
    if gas_map.variance is not None:
        pictures["standard deviation [ppm]"] = np.sqrt(gas_map.variance)
    figure = Figure(figsize=(5.2 * len(pictures), 1.2 + 4.4 * size[1] / size[0]), layout="constrained")
    axes = figure.subplots(1, len(pictures), squeeze=False)[0]
    nx, ny = gas_map.estimate.shape
    for axis, (title, values) in zip(axes, pictures.items(), strict=True):
        picture = axis.imshow(values.T, origin="lower", extent=(0, nx * gas_map.cell, 0, ny * gas_map.cell))
        figure.colorbar(picture, ax=axis, shrink=0.8)
        axis.plot(*readings.place.T, ".", color="white", markersize=1, alpha=0.4)
        axis.set(xlim=(0, size[0]), ylim=(0, size[1]), xlabel="x [m]", ylabel="y [m]", title=title)
    figure.savefig(path, dpi=110)


def _log(values: np.ndarray) -> np.ndarray:
    return np.log10(np.where(values > 0, values, np.nan))


# ---------------------------------------------------------------- the command


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line `argv` (without the program's name) and return its exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m taichi_plume.maps",
        description="Make a gas map of recorded readings. Other options are the map's parameters, as --cell 0.25.",
        allow_abbrev=False,
    )
    parser.add_argument("readings", type=Path, help="robots.parquet of a run, or a CSV with t, x, y, reading")
    parser.add_argument("--kind", default="time_series", help="of the map (default: time_series)")
    parser.add_argument(
        "--size", type=_length, nargs=2, required=True, metavar=("LX", "LY"), help="of the floor [m]"
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="where the map goes")
    parser.add_argument("--trial", type=int, default=0, metavar="N", help="of several (default: the first)")
    parser.add_argument(
        "--source",
        type=float,
        nargs=2,
        action="append",
        metavar=("X", "Y"),
        help="a source [m], to score the peak",
    )
    args, others = parser.parse_known_args(argv)
    os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "0")
    try:
        model = _model(args.kind, others)
        readings = read(args.readings, args.trial)
        from taichi_plume import kernels

        kernels.start("cpu")
        size = (args.size[0], args.size[1])
        gas_map = map_of(readings, model, size, np.array(args.source) if args.source else None)
    except ReadingsError as error:
        print(error, file=sys.stderr)
        return 2
    try:
        args.out.mkdir(parents=True, exist_ok=True)
        write(gas_map, readings, size, args.out)
    except OSError as error:
        print(f"{args.out}: cannot be written: {error.strerror or error}", file=sys.stderr)
        return 1
    peak = gas_map.scores["peak"]
    print(
        f"peak {peak['ppm']:.3g} ppm at ({peak['x_m']:.2f}, {peak['y_m']:.2f}) m"
        if peak["ppm"] is not None
        else "knows no cell"
    )
    print(f"{args.out}: {', '.join(FILES)}")
    return 0


def _length(text: str) -> float:
    value = float(text)
    if not 0.0 < value <= 1e4:
        raise argparse.ArgumentTypeError(f"must be a length in m, got '{text}'")
    return value


def _model(kind: str, options: list[str]) -> "Map":
    """The model of a map with these parameters. Raises ReadingsError."""
    import yaml
    from pydantic import TypeAdapter, ValidationError

    from taichi_plume.loading import explain
    from taichi_plume.map_models import Map

    data: dict[str, Any] = {"kind": kind}
    left = [part for option in options for part in option.split("=", 1)] if options else []
    while left:
        name = left.pop(0)
        if not name.startswith("--") or not left:
            raise ReadingsError(f"{name}: parameters of the map go by --name value")
        try:
            data[name[2:].replace("-", "_")] = yaml.safe_load(left.pop(0))
        except yaml.YAMLError:
            raise ReadingsError(f"{name}: has a value that cannot be read") from None
    adapter: TypeAdapter[Map] = TypeAdapter(Map)
    try:
        return adapter.validate_python(data)
    except ValidationError as error:
        raise ReadingsError("; ".join(explain(error, data))) from None


if __name__ == "__main__":
    sys.exit(main())
