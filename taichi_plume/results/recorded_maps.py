"""Gas maps from recorded readings, by the same mapping algorithms that robots run online.

During a run a map forgets old readings, to follow the gas. For a map of a log, the model's `times` (window, memory and
the like) are chosen so that no reading is forgotten, unless the model sets one of them. A map is written as

    map.csv      x, y [m] of each cell's middle, ppm, weight and, if the method estimates it, variance_ppm2
    map.png      the same, seen from above
    scores.json  see `GasMap`
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from taichi_plume.files import disk
from taichi_plume.files.film import BACKGROUND
from taichi_plume.files.json_values import json_value
from taichi_plume.files.maps_file import MEANING
from taichi_plume.files.readings import Readings, ReadingsError
from taichi_plume.files.run_folder import RunFolder, read_json

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from taichi_plume.agents.gas_map import GasMap as OnlineMap
    from taichi_plume.scenario.maps import Map

FILES = ("map.csv", "map.png", "scores.json")

MOST_WINDOWS = 100_000  # of a log: six days of 5 s each; more is a clock that jumped
FINEST = 6  # significant decimals of a time [s]: a Unix time in double precision has no more
FORGOTTEN = 1e-3  # fraction of its weight below which a reading counts as forgotten


@dataclass(frozen=True, eq=False, repr=False)
class GasMap:
    """Gas map of recorded readings; a notebook shows it.

    estimate, weight, variance: arrays (nx, ny) of the estimate [ppm], its weight and its variance [ppm²] or None;
    estimate and variance are NaN where nothing is known. cell: edge of the cells [m]; size: of the floor [m]. model:
    section of the map, with the parameters chosen for the log. readings: the readings, at positions on the floor.
    background: gas in clean air [ppm], above which estimate, scores and `readings` count.
    scores::

        background_ppm              gas in clean air, above which all count
        kind, readings, left_out    kind of map; readings in the map; readings that are no number or off the floor
        forgotten                   readings in the map with less than FORGOTTEN of their weight left at the end
        chosen_for_the_log          parameters chosen so that nothing is forgotten (see `of_log`)
        known_fraction              share of the cells that have an estimate
        peak                        x_m, y_m and ppm of the largest estimate; to_source_m, if sources are known
        forecast_error_ppm          mean of eq 8 (see agents/snapshots), from 30 s after the first reading on; or None
        forecast                    time_s and error_ppm of each forecast snapshot
        nlpd, nlpd_median           negative log predictive density of the readings of each snapshot, or PERIOD, by the
                                    map before (see scoring/maps); None without a variance
    """

    cell: float
    estimate: np.ndarray
    weight: np.ndarray
    variance: np.ndarray | None
    scores: dict[str, Any]
    model: "Map"
    readings: Readings
    size: tuple[float, float]
    background: float = 0.0

    @property
    def data(self) -> "xarray.Dataset":
        """Dataset over y and x [m]: estimate [ppm], weight and, if the method estimates it, variance [ppm²].

        x and y are those of the cell centres, from the lower corner of the floor on. Attributes: kind and parameters of
        the map.
        """
        import xarray

        def variable(name: str, dims: Sequence[str], values: np.ndarray) -> tuple[Any, ...]:
            return dims, values, dict(zip(("units", "long_name"), MEANING[name], strict=False))

        names = ("estimate", "weight", "variance")[: 3 if self.variance is not None else 2]
        axes = zip("xy", self.estimate.shape, strict=True)
        return xarray.Dataset(
            {name: variable(name, ("y", "x"), vars(self)[name].T) for name in names},
            {name: variable(name, (name,), (np.arange(n) + 0.5) * self.cell) for name, n in axes},
            self.model.model_dump(mode="json", exclude_none=True) | {BACKGROUND: self.background},
        )

    @property
    def lines(self) -> list[str]:
        """Lines on the map, as the command prints: its peak, how many readings count, and what was assumed of them."""
        peak = self.scores["peak"]
        if peak["ppm"] is None:
            line = "the map is empty: its last readings are too old"
        elif peak["x_m"] is None:
            line = "no gas: 0 ppm in all known cells"
        else:
            above = f" above {self.background:g} ppm" if self.background else ""
            line = f"peak {peak['ppm']:.3g} ppm{above} at ({peak['x_m']:.2f}, {peak['y_m']:.2f}) m"
        notes = [f"note: {remark}" for remark in self.readings.facts.remarks]
        return [line, _used(self.scores, self.model.times), *notes]

    def plot(self, *, ax: "Axes | None" = None, figsize: tuple[float, float] | None = None) -> "Figure":
        """Return the figure of map.png: estimate, weight and, if there is one, standard deviation, seen from above.

        ax: axes of a figure of yours, for the estimate alone; figsize: width and height of a new figure [inches].
        Raises InputError if both are given.
        """
        from taichi_plume.report.recorded_map import figure
        from taichi_plume.report.theme import Place

        return figure(self, Place.of(ax, figsize))

    def write(self, folder: str | Path, force: bool = False) -> None:
        """Write map.csv, map.png and scores.json into a folder. force: rename the folder of an earlier map.

        Raises RunFolderError if the folder holds other files, and OSError.
        """
        with map_folder(Path(folder), force, self.readings.path) as held:
            self.write_into(held)

    def write_into(self, held: RunFolder) -> None:
        """Write the files into a folder that this process holds, see `map_folder`. Raises OSError."""
        from taichi_plume.report.theme import png

        held.start()
        folder = held.path
        table = self.data.to_dataframe(["x", "y"])
        table = table.rename(columns={"estimate": "ppm", "variance": "variance_ppm2"}).reset_index()
        with disk.written_whole(folder / FILES[0]) as fresh:
            table.to_csv(fresh, index=False, float_format="%.7g", na_rep="nan", lineterminator="\n")
        with disk.written_whole(folder / FILES[1]) as fresh:
            fresh.write_bytes(png(self.plot()))
        text = json.dumps(json_value(self.scores), indent=2, allow_nan=False) + "\n"
        with disk.written_whole(folder / FILES[2]) as fresh:
            fresh.write_text(text, encoding="utf-8")

    def _repr_html_(self) -> str:
        from taichi_plume.report.html import in_notebook
        from taichi_plume.report.theme import png

        labels = (f"{self.model.kind} map", "readings", *["note"] * len(self.lines))
        return in_notebook(list(zip(labels, self.lines, strict=False)), picture=png(self.plot()))

    def __repr__(self) -> str:
        return "\n".join(self.lines)


def map_folder(folder: Path, force: bool, readings: Path | None) -> RunFolder:
    """Return the locked folder for the files of a map. readings: file of the map's readings, which must lie elsewhere.

    Raises RunFolderError if the folder holds files, except those of an earlier map with `force`.
    """
    inputs = [] if readings is None else [readings]
    return RunFolder("", folder, force, inputs=inputs, ours=_is_map)


def _is_map(folder: Path) -> bool:
    """Return whether a folder holds a gas map, by the keys of its scores.json."""
    return read_json(folder / FILES[2]).keys() >= {"kind", "readings", "known_fraction"}


def map_of(
    readings: Readings,
    model: "Map",
    size: tuple[float, float],
    sources: np.ndarray | None = None,
    background: float = 0.0,
) -> GasMap:
    """Return a gas map of recorded readings above a background [ppm], which they do not contain.

    size: of the floor [m]; sources: true positions (m, 2) [m], for scores.

    Starts Taichi unless it runs. Snapshots end at multiples of the window since t = 0, or since the first reading if
    the window was chosen for the log. The last snapshot is mapped, but its forecast is not scored.

    Raises ReadingsError.
    """
    from taichi_plume.engine import program
    from taichi_plume.scoring.trials import PERIOD, forecast_error, peak_distance
    from taichi_plume.time_loop import Uncertain

    if vars(model).get("layer") is not None:
        raise ReadingsError("--map.layer: a log has places on the floor, without heights; leave it out")
    fault = model.grid_error("--map", size)
    if fault:
        raise ReadingsError(fault)
    if model.measures == "wind":
        raise ReadingsError(
            f"--map.kind: {model.kind} is a map of the wind, made by runs alone; use a map of the gas"
        )
    if model.robot is not None:
        raise ReadingsError("--map.robot: a log does not tell what a robot has received; leave it out")
    if vars(model).get("samples") == "newest" and readings.robot is None:
        raise ReadingsError(
            "--map.samples: newest needs the robot of each reading, a column 'robot' or 'group'"
        )
    counted = _counted(readings, size)
    _check_clock(readings, model.window or PERIOD)
    model, chosen = of_log(model, readings, size)
    window = model.window or PERIOD
    begin = readings.t[0]
    if "window" not in chosen:
        begin = window * np.floor((begin + 0.5 * 10.0**-FINEST) / window)
    t = np.round(readings.t - begin, FINEST)
    program.ensure_started()
    gas_map, dt, nlpd = _made(readings, t, model, size)
    errors = [(time, error) for time, error in gas_map.errors if time <= t[-1] + 10.0**-FINEST]
    estimate, weight = np.asarray(gas_map.estimate()), np.asarray(gas_map.weight())
    settled = float(forecast_error(errors, 1, t[0])[0])
    left = gas_map.remembered(t[counted], readings.place[counted], dt)
    peak = _peak(estimate[0], gas_map.cell)
    if sources is not None:
        peak["to_source_m"] = float(peak_distance(estimate, gas_map.cell, sources)[0])
    scores = {
        "kind": model.kind,
        BACKGROUND: background,
        "readings": int(counted.sum()),
        "forgotten": None if np.isnan(left).any() else int((left < FORGOTTEN).sum()),
        "left_out": int((~counted).sum()),
        "chosen_for_the_log": chosen,
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
    return GasMap(gas_map.cell, estimate[0], weight[0], variance, scores, model, readings, size, background)


def of_log(model: "Map", readings: Readings, size: tuple[float, float]) -> tuple["Map", dict[str, Any]]:
    """Return a mapping model whose parameters let no recorded reading be forgotten, and these parameters.

    A model that sets one of its `times` is returned unchanged, with {}. size: of the floor [m].
    """
    if model.model_fields_set & set(model.times):
        return model, {}
    chosen = model.of_log(float(np.round(readings.t[-1] - readings.t[0], FINEST)), size)
    return model.model_copy(update=chosen), chosen


def _made(
    readings: Readings, t: np.ndarray, model: "Map", size: tuple[float, float]
) -> tuple["OnlineMap", float, np.ndarray]:
    """Map readings taken at times t [s]; return map, time step [s], finite negative log densities of the readings."""
    from taichi_plume.agents.gas_map import Floor
    from taichi_plume.agents.mapping import mappers
    from taichi_plume.agents.recorded_readings import RecordedTeam
    from taichi_plume.scoring.trials import PERIOD, Prediction

    times, starts, robots = np.unique(t, return_index=True, return_counts=True)
    most, window = int(robots.max()), model.window or PERIOD
    number_of = readings.robot if vars(model).get("samples") == "newest" else None
    if number_of is not None:
        most = max(most, int(number_of.max()) + 1)
    team = RecordedTeam(most)
    dt = window / ceil(np.bincount(_number(t, window)).max() / most)  # maps have room for so many readings
    gas_map = mappers([model], Floor(size, 1, most, dt))[0]

    def take_in(first: int, last: int, time: float) -> None:
        rows = slice(first, last)
        robot = None if number_of is None else number_of[rows]
        team.show(readings.place[rows], readings.wind[rows], readings.reading[rows], robot)
        gas_map.update(team, time, dt)

    period = gas_map.window or PERIOD
    prediction, ended, surprises = None, 0, [np.empty(0)]
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
    nlpd = np.concatenate(surprises)
    return gas_map, dt, nlpd[np.isfinite(nlpd)]


def _number(t: np.ndarray, window: float) -> np.ndarray:
    """Return the index, from 0, of the time window that contains t [s]; a window includes its end, not its start."""
    return np.maximum(np.ceil(t / window - 1e-9), 1.0).astype(int) - 1


def _counted(readings: Readings, size: tuple[float, float]) -> np.ndarray:
    """Return a mask (n,) of the finite readings on a floor of this size [m]. Raises ReadingsError if there are none."""
    known = np.isfinite(readings.reading)
    if not known.any():
        raise ReadingsError(f"none of the {len(known)} readings is a number")
    counted = ((readings.place >= 0.0) & (readings.place <= size)).all(axis=1) & known
    if not counted.any():
        low, high = readings.place[known].min(axis=0), readings.place[known].max(axis=0)
        raise ReadingsError(
            f"no reading lies on the floor of {size[0]:g} x {size[1]:g} m from the origin on; they reach from "
            f"({low[0]:g}, {low[1]:g}) to ({high[0]:g}, {high[1]:g}) m from there, see --origin"
        )
    return counted


def _check_clock(readings: Readings, window: float) -> None:
    t = readings.t - readings.t[0]
    if t[-1] / window <= MOST_WINDOWS:
        return
    n = int(np.diff(t).argmax()) + 1
    raise ReadingsError(
        f"row {readings.row[n]}: t = {readings.t[n]:.10g} s is {t[n] - t[n - 1]:.3g} s after the time before it: a map "
        f"takes {MOST_WINDOWS} windows of {window:g} s; correct the clock or cut the log"
    )


def _peak(estimate: np.ndarray, cell: float) -> dict[str, float | None]:
    """Return position [m] and value [ppm] of a map's largest estimate; None if unknown or not above zero."""
    known = np.isfinite(estimate).any()
    if not known or np.nanmax(estimate) <= 0.0:
        return {"x_m": None, "y_m": None, "ppm": 0.0 if known else None}
    i, j = np.unravel_index(np.nanargmax(estimate), estimate.shape)
    return {"x_m": (float(i) + 0.5) * cell, "y_m": (float(j) + 0.5) * cell, "ppm": float(estimate[i, j])}


def _used(scores: dict[str, Any], times: Sequence[str]) -> str:
    """Return a text on the readings of the log that a map uses. times: parameters that limit the age of readings."""
    forgotten, text = scores["forgotten"], f"{scores['readings']:,} readings"
    if forgotten:
        text = f"{forgotten:,} of {text} forgotten; without {' and '.join(times)} the map is of the whole log"
    elif forgotten == 0:
        text += ", none forgotten"
    chosen = [
        f"{name}: {'null' if value is None else f'{value:.4g}'}"
        for name, value in scores["chosen_for_the_log"].items()
    ]
    text += f"; chosen so that no reading is forgotten: {', '.join(chosen)}" if chosen else ""
    left_out = f"; {scores['left_out']:,} left out, as no number or off the floor"
    return text + left_out * bool(scores["left_out"])
