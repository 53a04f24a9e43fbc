"""Gas maps of recorded readings: ``python -m taichi_plume.maps READINGS --kind time_series --size 4 3 --out DIR``.

READINGS is the robots.parquet of a run or a CSV file (see `readings`). The map is told as in a scenario, such as
``--map '{kind: time_series, alpha: 0.9, cell: 10 cm}'``; ``--kind gmrf --help`` lists the parameters of a kind. The
readings go through the very maps that robots make online. In DIR:

    map.csv      x, y [m] of each cell's middle, ppm, weight and, where the map tells it, variance_ppm2
    map.png      the same, seen from above
    scores.json  see `GasMap.scores`

From Python::

    readings = read("readings.csv")
    kernels.start("cpu")
    gas_map = map_of(readings, KernelMap(kind="kernel_dmv"), size=(4.0, 3.0))
"""

import json
import os
import sys
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from math import ceil, isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from taichi_plume.files.readings import Readings, ReadingsError, read
from taichi_plume.guard.terminal import say, visible
from taichi_plume.map_options import arguments

if TYPE_CHECKING:
    from taichi_plume.scenario.maps import Map

FILES = ("map.csv", "map.png", "scores.json")
MOST_WINDOWS = 100_000  # more, at 5 s six days, is a clock that jumped
FINEST = 6  # decimals of a time [s] that count: a Unix time has no more
MOST_OBLONG = 4.0  # of a picture


@dataclass(frozen=True)
class GasMap:
    """A finished map: estimate [ppm], weight and variance [ppm²] or None, (nx, ny), with cells of `cell` [m].

    estimate and variance are NaN where nothing is known. scores:

        kind, readings, left_out    of the map; how many went into it, and how many are no number or off the floor
        known_fraction              share of the cells that have an estimate
        peak                        x_m, y_m and ppm of the largest estimate; to_source_m, if sources are known
        forecast_error_ppm          mean of eq 8 (see agents/snaps), from 30 s after the first reading on; or None
        forecast                    time_s and error_ppm of each snap that was forecast
        nlpd, nlpd_median           of the readings of each snap, or PERIOD, by the map before them (see map_scores); or
                                    None, where the map tells no variance
    """

    cell: float
    estimate: np.ndarray
    weight: np.ndarray
    variance: np.ndarray | None
    scores: dict[str, Any]


def map_of(
    readings: Readings, model: "Map", size: tuple[float, float], sources: np.ndarray | None = None
) -> GasMap:
    """The map of readings on a floor of this size [m]; Taichi must have been started. sources: (m, 2) [m], if known.

    Snaps are cut at multiples of their window since the time 0; those before the first reading are left out. At the
    end the running snap goes into the map as well, but its forecast is not judged. Raises ReadingsError.
    """
    from taichi_plume.agents.gas_map import Floor
    from taichi_plume.agents.mapping import mappers
    from taichi_plume.agents.recorded import RecordedTeam
    from taichi_plume.scores import PERIOD, Prediction, forecast_error, peak_distance
    from taichi_plume.simulation import Uncertain

    fault = model.too_fine("--map", size)
    if fault:
        raise ReadingsError(fault)
    counted = _counted(readings, size)
    window = model.window or PERIOD
    begin = window * np.floor((readings.t[0] + 0.5 * 10.0**-FINEST) / window)
    t = np.round(readings.t - begin, FINEST)
    _check_clock(readings, t, window)
    times, starts, robots = np.unique(t, return_index=True, return_counts=True)
    most = int(robots.max())
    team = RecordedTeam(most)
    dt = window / ceil(np.bincount(_number(t, window)).max() / most)  # maps have room for so many readings
    gas_map = mappers([model], Floor(size, 1, most, dt))[0]

    def take_in(first: int, last: int, time: float) -> None:
        rows = slice(first, last)
        team.show(readings.place[rows], readings.wind[rows], readings.reading[rows])
        gas_map.update(team, time, dt)

    period = gas_map.window or PERIOD
    prediction, ended, surprises = None, 0, []
    for time, number, first, count in zip(times, _number(times, period), starts, robots, strict=True):
        last = first + count
        if number > ended:
            ended = number
            take_in(0, 0, ended * period)
            prediction = Prediction.of(gas_map, size)
        if prediction:
            surprises.append(prediction.surprise(0, readings.place[first:last], readings.reading[first:last]))
        take_in(first, last, float(time))
    if model.window is not None:
        take_in(0, 0, float(_number(times[-1], window) + 1) * window)
    errors = [(time, error) for time, error in gas_map.errors if time <= times[-1] + 10.0**-FINEST]
    estimate, weight = np.asarray(gas_map.estimate()), np.asarray(gas_map.weight())
    settled = float(forecast_error(errors, 1, times[0])[0])
    nlpd = np.concatenate(surprises or [np.empty(0)])
    nlpd = nlpd[np.isfinite(nlpd)]
    peak = _peak(estimate[0], gas_map.cell)
    if sources is not None:
        peak["to_source_m"] = float(peak_distance(estimate, gas_map.cell, sources)[0])
    scores = {
        "kind": model.kind,
        "readings": int(counted.sum()),
        "left_out": int((~counted).sum()),
        "known_fraction": float(np.isfinite(estimate).mean()),
        "peak": peak,
        "forecast_error_ppm": settled if isfinite(settled) else None,
        "forecast": {
            "time_s": [float(time + begin) for time, _ in errors],
            "error_ppm": [float(error[0]) for _, error in errors],
        },
        "nlpd": float(nlpd.mean()) if nlpd.size else None,
        "nlpd_median": float(np.median(nlpd)) if nlpd.size else None,
    }
    variance = np.asarray(gas_map.variance())[0] if isinstance(gas_map, Uncertain) else None
    return GasMap(gas_map.cell, estimate[0], weight[0], variance, scores)


def _number(t: np.ndarray, window: float) -> np.ndarray:
    """Number, from 0 on, of the window that a time [s] belongs to: the one it ends, if it ends one."""
    return np.maximum(np.ceil(t / window - 1e-9), 1.0).astype(int) - 1


def _counted(readings: Readings, size: tuple[float, float]) -> np.ndarray:
    """Which readings go into a map of this size [m]."""
    told = np.isfinite(readings.reading)
    if not told.any():
        raise ReadingsError(f"none of the {len(told)} readings is a number")
    counted = ((readings.place >= 0.0) & (readings.place <= size)).all(axis=1) & told
    if not counted.any():
        low, high = readings.place[told].min(axis=0), readings.place[told].max(axis=0)
        raise ReadingsError(
            f"no reading lies on the floor of {size[0]:g} x {size[1]:g} m from the origin on; they reach from "
            f"({low[0]:g}, {low[1]:g}) to ({high[0]:g}, {high[1]:g}) m"
        )
    return counted


def _check_clock(readings: Readings, t: np.ndarray, window: float) -> None:
    if t[-1] / window <= MOST_WINDOWS:
        return
    n = int(np.diff(t).argmax()) + 1
    raise ReadingsError(
        f"row {readings.row[n]}: t = {readings.t[n]:.10g} s is {t[n] - t[n - 1]:.3g} s after the time before it: a map "
        f"takes {MOST_WINDOWS} windows of {window:g} s; correct the clock or cut the log"
    )


def _peak(estimate: np.ndarray, cell: float) -> dict[str, float | None]:
    """Where the largest estimate is [m], and how large [ppm]; None where the map knows nothing."""
    if not np.isfinite(estimate).any():
        return {"x_m": None, "y_m": None, "ppm": None}
    i, j = np.unravel_index(np.nanargmax(estimate), estimate.shape)
    return {"x_m": (float(i) + 0.5) * cell, "y_m": (float(j) + 0.5) * cell, "ppm": float(estimate[i, j])}


def write(gas_map: GasMap, readings: Readings, size: tuple[float, float], folder: Path) -> None:
    """Write FILES into an existing folder."""
    from taichi_plume.files.result import plain

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
    oblong = min(max(size[1] / size[0], 1 / MOST_OBLONG), MOST_OBLONG)
    aspect = "equal" if oblong == size[1] / size[0] else "auto"
    figure = Figure(figsize=(5.2 * len(pictures), 1.2 + 4.4 * oblong), layout="constrained")
    axes = figure.subplots(1, len(pictures), squeeze=False)[0]
    nx, ny = gas_map.estimate.shape
    extent = (0, nx * gas_map.cell, 0, ny * gas_map.cell)
    for axis, (title, values) in zip(axes, pictures.items(), strict=True):
        picture = axis.imshow(values.T, origin="lower", extent=extent, aspect=aspect)
        figure.colorbar(picture, ax=axis, shrink=0.8)
        axis.plot(*readings.place.T, ".", color="white", markersize=1, alpha=0.4)
        axis.set(xlim=(0, size[0]), ylim=(0, size[1]), xlabel="x [m]", ylabel="y [m]", title=title)
    figure.savefig(path, dpi=110)


def _log(values: np.ndarray) -> np.ndarray:
    return np.log10(np.where(values > 0, values, np.nan))


# ---------------------------------------------------------------- the command


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line `argv` (without the program's name) and return its exit code."""
    os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "0")
    try:
        args, model = arguments(sys.argv[1:] if argv is None else argv)
        from taichi_plume.files.run_folder import RunFolderError, run_folder
        from taichi_plume.grid import kernels

        try:
            out = run_folder("", args.out, args.force, files=FILES)
        except RunFolderError as error:
            raise ReadingsError(str(error)) from None
        try:
            readings = read(args.readings, args.trial, args.group)
            kernels.start("cpu")
            gas_map = map_of(readings, model, args.size, np.array(args.source) if args.source else None)
        except BaseException:
            with suppress(OSError):
                out.rmdir()  # unless something is in it
            raise
    except ReadingsError as error:
        say(visible(error), error=True)
        return 2
    except KeyboardInterrupt:
        say("interrupted before the map was made", error=True)
        return 130
    try:
        write(gas_map, readings, args.size, out)
    except OSError as error:
        say(visible(f"{out}: cannot be written: {error.strerror or error}"), error=True)
        return 1
    peak = gas_map.scores["peak"]
    if peak["ppm"] is None:
        say("knows no cell: its last readings are too old")
    else:
        say(f"peak {peak['ppm']:.3g} ppm at ({peak['x_m']:.2f}, {peak['y_m']:.2f}) m")
    say(visible(f"{out}: {', '.join(FILES)}"))
    return 0


if __name__ == "__main__":
    sys.exit(main())
