"""Gas map of recorded readings: ``tp.maps("readings.csv", size=(4, 3))`` is ``taichi-plume maps``."""

from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
from pydantic import Field

from taichi_plume.files.bag_readings import BagOptions
from taichi_plume.files.readings import ReadingsError, read
from taichi_plume.files.run_folder import is_run
from taichi_plume.guard.safe_open import as_path
from taichi_plume.quantities import Number
from taichi_plume.results.recorded_maps import GasMap, map_folder, map_of
from taichi_plume.results.run import Run
from taichi_plume.results.tracks import ABOVE
from taichi_plume.scenario import si
from taichi_plume.scenario.loading import load_part
from taichi_plume.scenario.maps import Map

if TYPE_CHECKING:
    import pandas

SIZE = tuple[si.Length, si.Length]
TRIAL = Annotated[int, Field(ge=0)] | None
BAG_KEYS = [field.name for field in fields(BagOptions) if field.name != "lenient"]


def maps(
    readings: "Run | str | Path | pandas.DataFrame",
    map: Annotated[str | Mapping[str, object] | Map, "--map MAP"] = "time_series",
    *,
    size: Annotated[Sequence[Number] | None, "--size LX LY"] = None,
    origin: Annotated[Sequence[Number], "--origin X Y"] = (0.0, 0.0),
    out: Annotated[str | Path | None, "DIR"] = None,
    force: bool = False,
    trial: Annotated["int | None", "N"] = None,
    group: Annotated[str | None, "NAME"] = None,
    sources: Annotated[Sequence[Sequence[Number]] | None, "--source X Y ..."] = None,
    background: Annotated[Number | None, "PPM"] = None,
    columns: Annotated[Mapping[str, str] | None, "--columns KEY=NAME,... ..."] = None,
    missing: Annotated[Sequence[float], "--missing NUMBER ..."] = (),
    bag: Mapping[str, object] | BagOptions | None = None,
) -> GasMap:
    """Make a gas map of recorded readings. Return the map.

    readings: a run or its folder, robots.parquet of a run, a bag of ROS (a folder, .mcap, .db3, .bag), or a CSV file
    with the columns t [s], x, y [m] and reading [ppm]; in Python also a DataFrame. map: a kind, or the map as in a
    scenario: '{kind: time_series, alpha: 0.9, cell: 10 cm}', in Python also keys and values. size: edges of the floor
    along x and y [m], by default those of the run. origin: lower corner of the floor [m], from which positions in the
    map count, by default 0 0. trial: number of the trial, by default the first. group: group, in a bag a robot, by
    default all robots of the trial. sources: true position of a source [m], to score the peak; may be repeated; by
    default those of the run.

    columns: names of a table's columns for t, x, y, reading and so on, with or without a unit: t=stamp [ms],x=px, in
    Python ``{"t": "stamp [ms]"}``; by default as the header names them. missing: number that means no reading, besides
    NaN, -999 and -9999; may be repeated.

    background: reading in clean air [ppm], such as 420 for CO2, above which the map counts. Unless given 0, or in a run
    with a background the readings above it are taken.

    bag: how a ROS bag is read, by the keys gas, pose and wind (lists of topics), reading (numbers in messages of any
    type, such as ``["/enose.data[0]"]``), frame, sensor, units, model, air and upwind; `origin` is a position in that
    frame.

    out: folder for map.csv, map.png and scores.json, by default none. force: rename the folder of an earlier map to
    `out`.old.

    All readings count unless the map's parameters limit their age. Raises InputError (ReadingsError, ScenarioError,
    RunFolderError), whose lines name the options of the command, and OSError.

    >>> import taichi_plume as tp
    >>> run = tp.simulate("plumesim_casting", duration=2, out=folder)
    >>> gas_map = tp.maps(run, {"kind": "inverse_distance", "cell": "50 cm"})
    >>> dict(gas_map.data.estimate.sizes), gas_map.data.estimate.attrs["units"]
    ({'y': 6, 'x': 8}, 'ppm')
    >>> gas_map.scores["readings"]
    20
    """
    model = _model(map)
    floor = None if size is None else load_part(size, "--size", SIZE)
    corner = np.array(load_part(origin, "--origin", si.Point2))
    trial = load_part(trial, "--trial", TRIAL)
    options = _bag_options(bag)
    clean: float | None = load_part(background, "--background", si.Concentration | None)
    known = 0.0
    places = None if sources is None else load_part(sources, "--source", tuple[si.Point2, ...])
    if isinstance(readings, str | Path):
        readings = as_path(readings, "readings", ReadingsError)
        readings = Run(readings) if is_run(readings) else readings
    if isinstance(readings, Run):
        scenario = readings.scenario
        for robots in scenario.robots:
            if robots.sensors.nose.integrates and group in (None, robots.name):
                raise ReadingsError(
                    f"the readings of '{robots.name}' are integrals along beams, which a log does not have; "
                    "map them in the run, by maps: [{kind: gmrf}] in its scenario"
                )
        width, length = scenario.domain.extent[:2]
        floor = floor or (width - corner[0], length - corner[1])
        if places is None:
            at_end = scenario.targets_at(scenario.duration)
            places = at_end[np.isfinite(at_end[:, 0]), :2].tolist()
        table = readings.folder / "robots.parquet"
        readings = table if table.exists() else readings.robots
        gases = sum(scenario.backgrounds.values())
        if gases and clean is None and "reading" not in (columns or {}):
            columns = {**(columns or {}), "reading": ABOVE}
            known = gases
    if floor is None:
        raise ReadingsError("--size: is missing; give the edges of the floor along x and y [m]")
    file = readings if isinstance(readings, Path) else None
    with nullcontext() if out is None else map_folder(as_path(out, "out"), force, file) as folder:
        log = read(
            readings, trial, group, options, columns, load_part(missing, "--missing", tuple[float, ...])
        )
        log = replace(log, place=log.place - corner, reading=log.reading - (clean or 0.0))
        try:
            sites = np.array(places) - corner if places else None
            gas_map = map_of(log, model, floor, sites, known or clean or 0.0)
        except ReadingsError as error:
            raise ReadingsError(*log.topics, *error.lines) from None
        if folder is not None:
            gas_map.write_into(folder)
    return gas_map


def _model(map: str | Mapping[str, object] | Map) -> Map:
    """Return the section of a gas map that is given as a kind, a YAML text, or keys and values."""
    is_kind = isinstance(map, str) and not map.lstrip().startswith("{")
    return load_part({"kind": map} if is_kind else map, "--map", Map)


def _bag_options(bag: Mapping[str, object] | BagOptions | None) -> BagOptions | None:
    unknown = [key for key in bag if key not in BAG_KEYS] if isinstance(bag, Mapping) else []
    if unknown:
        raise ReadingsError(f"bag: unknown key '{unknown[0]}'; allowed: {', '.join(BAG_KEYS)}")
    return bag if bag is None or isinstance(bag, BagOptions) else load_part(bag, "bag", BagOptions)
