"""``python -m taichi_plume.maps READINGS --kind time_series --size 4 3 --out DIR`` makes a gas map of readings.

READINGS is the robots.parquet of a run, a bag of ROS or a CSV file (see `readings`). The map is given as in a scenario,
such as ``--map '{kind: time_series, alpha: 0.9, cell: 10 cm}'``; ``--kind gmrf --help`` lists the parameters of a kind.
The readings go through the mapping methods that robots use online; by default all readings of the log count (see
`recorded_maps`). In DIR:

    map.csv      x, y [m] of each cell's middle, ppm, weight and, if the method estimates it, variance_ppm2
    map.png      the same, seen from above
    scores.json  see `recorded_maps.GasMap`

From Python::

    readings = read("readings.csv")
    kernels.start("cpu")
    gas_map = map_of(readings, KernelMap(kind="kernel_dmv"), size=(4.0, 3.0))
"""

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from taichi_plume.cli.exit_codes import exit_code
from taichi_plume.cli.map_options import arguments, bag_options
from taichi_plume.files import disk
from taichi_plume.files.json_values import json_value
from taichi_plume.files.readings import Readings, read
from taichi_plume.guard.terminal import say
from taichi_plume.results.recorded_maps import GasMap, map_of
from taichi_plume.scenario.maps import Map

FILES = ("map.csv", "map.png", "scores.json")
MOST_OBLONG = 4.0  # of a picture


def write(gas_map: GasMap, readings: Readings, size: tuple[float, float], folder: Path) -> None:
    """Write a gas map into an existing folder: map.csv, map.png and scores.json; size: of the floor [m]."""
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
    text = json.dumps(json_value(gas_map.scores), indent=2, allow_nan=False) + "\n"
    with disk.written_whole(folder / FILES[2]) as fresh:
        fresh.write_text(text, encoding="utf-8")


def _draw(gas_map: GasMap, readings: Readings, size: tuple[float, float], path: Path) -> None:
    from taichi_plume.report.theme import Figure

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

    def parse_and_make() -> int:
        args, model = arguments(sys.argv[1:] if argv is None else argv)
        return exit_code(lambda: _make(args, model), "interrupted before the map was made", out=args.out)

    return exit_code(parse_and_make)


def _make(args: argparse.Namespace, model: Map) -> int:
    from taichi_plume.files.run_folder import RunFolder
    from taichi_plume.grid import kernels

    with RunFolder("", args.out, args.force, inputs=[args.readings], files=FILES, ours=_is_map) as folder:
        readings = read(args.readings, args.trial, args.group, bag_options(args))
        origin = np.array(args.origin)
        readings = replace(readings, place=readings.place - origin)
        sources = np.array(args.source) - origin if args.source else None
        say(*readings.topics)
        kernels.start("cpu")
        gas_map = map_of(readings, model, args.size, sources)
        folder.clear()
        stands = False
        try:
            write(gas_map, readings, args.size, args.out)
            stands = True
        finally:
            folder.settle(stands)
    peak = gas_map.scores["peak"]
    if peak["ppm"] is None:
        say("the map is empty: its last readings are too old")
    elif peak["x_m"] is None:
        say("no gas: 0 ppm in all known cells")
    else:
        say(f"peak {peak['ppm']:.3g} ppm at ({peak['x_m']:.2f}, {peak['y_m']:.2f}) m")
    say(_used(gas_map.scores, model.times), f"{args.out}: {', '.join(FILES)}")
    return 0


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


def _is_map(folder: Path) -> bool:
    """Return whether a folder holds a gas map, by the keys of its scores.json."""
    from taichi_plume.files.run_folder import read_json

    return read_json(folder / "scores.json").keys() >= {"kind", "readings", "known_fraction"}
