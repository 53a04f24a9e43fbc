"""Probes: what they tell is what the air is like, at every step or at even times; forces at every step."""

from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from taichi_plume.assembly.assemble import build
from taichi_plume.assembly.preparation import checked
from taichi_plume.execution.forces_table import ForceTable
from taichi_plume.execution.probes_table import ProbeTable
from taichi_plume.grid.fields import ppm_at, velocity_at
from taichi_plume.scenario.loading import ScenarioError
from taichi_plume.scenario.probes import Probes
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.scenario.species import AIR_DENSITY
from taichi_plume.time_loop import Every

pytestmark = [pytest.mark.usefixtures("taichi"), pytest.mark.slow]

ROOM: dict[str, Any] = {
    "duration": 0.5,
    "warm_up": 0.2,
    "domain": {"size": [1.6, 1.2], "spacing": 0.1},
    "obstacles": [{"kind": "cylinder", "center": [1.0, 0.6], "radius": 0.25}],
    "wind": {
        "kind": "cfd",
        "openings": [{"kind": "inlet", "face": "x-", "speed": 0.8}, {"kind": "outlet", "face": "x+"}],
    },
    "gas": {
        "kind": "eulerian",
        "sources": [{"position": [0.3, 0.6], "rate": 1e-6}],
        "initial": {"concentration": "1e-5*x"},
    },
}
LINE = {"kind": "line", "name": "line", "start": [0.2, 0.3], "end": [0.6, 0.9], "count": 3}
POINT = {"kind": "point", "name": "one", "at": [1.4, 0.6]}
GRID = {"kind": "grid", "name": "grid", "low": [0.2, 0.4], "high": [0.4, 0.8], "counts": [2, 3]}
STILL: dict[str, Any] = {
    "duration": 0.2,
    "domain": {"size": [1.0, 0.8, 0.6], "spacing": 0.1},
    "wind": {
        "kind": "cfd",
        "acceleration": [1.5, 0, 0],
        "buoyancy": {"gravity": [0, 0, -9.81], "solutal": False, "heat": {}},
    },
    "gas": {
        "kind": "eulerian",
        "sources": [{"position": [0.3, 0.6, 0.3], "rate": 0}],
        "initial": {"concentration": "1e-5*(1 + x)"},
    },
}


def still(dim: int) -> dict[str, Any]:
    """A closed room, warmer above, or an upright section of it."""
    axes = [0, 2] if dim == 2 else [0, 1, 2]
    model = deepcopy(STILL)
    for section, key in (
        (model["domain"], "size"),
        (model["wind"], "acceleration"),
        (model["wind"]["buoyancy"], "gravity"),
        (model["gas"]["sources"][0], "position"),
    ):
        section[key] = [section[key][a] for a in axes]
    model["wind"]["buoyancy"]["heat"] = {"initial": {"temperature": f"290 + 5*{'xyz'[dim - 1]}"}}
    return model


def assembled(model: dict, **changes: Any) -> Any:
    return build(checked(Scenario.model_validate(model | changes), Path()))


def written(table: ProbeTable) -> pa.Table:
    table.close()
    return pq.read_table(table.path)


def table_of(sim: Any, path: Path, **model: Any) -> ProbeTable:
    table = ProbeTable(sim, path, Probes.model_validate(model))
    table.start()
    sim.step_observers.append(table.observer())
    return table


def test_rows_at_even_times_lie_between_those_of_steps(tmp_path):
    sim = assembled(ROOM)
    steps = table_of(sim, tmp_path / "steps.parquet", points=[LINE, POINT, GRID], every="step", start=-0.2)
    even = table_of(sim, tmp_path / "even.parquet", points=[LINE, POINT, GRID], every=0.03)
    forces = [ForceTable(sim, tmp_path / name) for name in ("steps.csv", "ticks.csv")]
    forces[0].every, forces[1].every = "step", 0.2
    for one in forces:
        one.start()
        observer = one.observer()
        (sim.observers if isinstance(observer, Every) else sim.step_observers).append(observer)
    sim.run()
    taken = len(steps.sampler.points)
    all_rows, rows = written(steps), written(even)
    t, due = all_rows["t"].to_numpy().reshape(-1, taken), rows["t"].to_numpy().reshape(-1, taken)
    assert len(t) == sim.steps + 1
    assert t[0, 0] == pytest.approx(-0.2)
    np.testing.assert_allclose(due[:, 0], np.arange(17) * 0.03, atol=1e-12)
    points = np.stack([all_rows[axis].to_numpy()[:taken] for axis in "xy"], axis=-1)
    np.testing.assert_allclose(points[:4], [[0.2, 0.3], [0.4, 0.6], [0.6, 0.9], [1.4, 0.6]], rtol=1e-6)
    np.testing.assert_allclose(points[5:7], [[0.2, 0.6], [0.2, 0.8]], rtol=1e-6)
    assert all_rows["probe"].to_pylist()[:5] == ["line", "line", "line", "one", "grid"]
    assert all_rows["point"].to_pylist()[:5] == [0, 1, 2, 0, 0]
    for name in ("wind_x", "wind_y", "ethanol_ppm", "pressure"):
        reported, fine = (one[name].to_numpy().reshape(-1, taken) for one in (rows, all_rows))
        for n in range(taken):
            exact = np.interp(due[:, n], t[:, n], fine[:, n])
            np.testing.assert_allclose(reported[:, n], exact, rtol=1e-5, atol=1e-6)
    last = {name: all_rows[name].to_numpy()[-taken:] for name in all_rows.column_names if name != "probe"}
    wind = velocity_at(sim.wind, points, sim.t)
    np.testing.assert_allclose(np.stack([last["wind_x"], last["wind_y"]], axis=-1), wind, atol=1e-6)
    np.testing.assert_allclose(last["ethanol_ppm"], ppm_at(sim.gas, points, sim.t)[:, 0], rtol=1e-6)
    for one in forces:
        one.close()
    each, seldom = (np.genfromtxt(one.path, delimiter=",", names=True) for one in forces)
    assert len(each) == (t[:, 0] >= 0).sum()
    np.testing.assert_array_equal(seldom["t_s"], [0.0, 0.2, 0.4, 0.5])
    at = np.searchsorted(each["t_s"], seldom["t_s"] - 1e-9)
    np.testing.assert_array_equal(each["x_N"][at], seldom["x_N"])
    assert len(np.unique(each["x_N"])) > 6


@pytest.mark.parametrize("dim", [2, pytest.param(3, marks=pytest.mark.slow)])
def test_a_still_room_has_its_closed_form(tmp_path, dim):
    """Pressure that bears the acceleration, temperature and gas as they began."""
    sim = assembled(still(dim))
    ends = [[0.15, 0.3, 0.3][3 - dim :], [0.85, 0.5, 0.3][3 - dim :]]
    ends[0][0], ends[1][0] = 0.15, 0.85
    line = {"kind": "line", "name": "along", "start": ends[0], "end": ends[1], "count": 8}
    table = table_of(sim, tmp_path / "probes.parquet", points=[line], every="step")
    sim.run()
    rows = written(table).drop_columns("probe")
    reported = {name: rows[name].to_numpy()[-8:] for name in rows.column_names}
    np.testing.assert_allclose(np.diff(reported["pressure"]), AIR_DENSITY * 1.5 * 0.1, rtol=1e-3)
    np.testing.assert_allclose(reported["temperature"], 291.5, atol=1e-3)
    unit = float(table.schema.field("ethanol_ppm").metadata[b"kg_per_m3"])
    np.testing.assert_allclose(reported["ethanol_ppm"] * unit, 1e-5 * (1 + reported["x"]), rtol=1e-4)
    # the acceleration alone would make 0.3 m/s
    assert max(np.abs(reported[f"wind_{axis}"]).max() for axis in "xyz"[:dim]) < 5e-4


@pytest.mark.parametrize(
    ("probes", "fault"),
    [
        ([POINT | {"at": [1.0, 0.7]}], r"points\[0\].at: \(1, 0.7\) m is inside obstacles\[0\]"),
        ([LINE | {"end": [1.2, 0.6]}], r"points\[0\].start and end: \(0.7, 0.45\) m|is inside obstacles"),
        ([POINT, LINE | {"end": [2, 1]}], r"points\[1\].start and end: x = 2 m is outside the domain"),
        ([POINT, POINT], r"points\[1\].name: 'one' is the name of points\[0\] too"),
        ([GRID | {"counts": [1000, 1000]}], "are 1,000,000 points, at most 100,000 are taken"),
        ([POINT | {"at": [1, 1, 1]}], "has 3 numbers, a 2-D run takes 2 here"),
    ],
)
def test_probes_have_to_be_in_the_air(probes, fault):
    with pytest.raises(ScenarioError, match=fault):
        assembled(ROOM, probes={"points": probes})


def test_forces_come_with_ticks_or_steps():
    with pytest.raises(ScenarioError, match=r"forces\.every: 0\.05 s is shorter than a tick"):
        assembled(ROOM, forces={"every": 0.05})
