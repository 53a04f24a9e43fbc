"""One place and time has one number: in the solver, pictures, gas_at, plots, NetCDF, bags and live topics."""

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray

import taichi_plume as tp
from taichi_plume.files import ros_messages as ros
from taichi_plume.grid import fields
from taichi_plume.serve.topics import Scene
from taichi_plume.time_loop import TimeLoop

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("taichi")]
HEIGHT = 0.34  # m, of slices and sensors: between two layers of cells
FLAT, HIGH = {"size": [1.6, 1.2], "spacing": 0.1}, {"size": [1.6, 1.2, 0.8], "spacing": 0.1}


def source(x: float, y: float, dim: int) -> dict[str, object]:
    return {"position": [x, y, HEIGHT][:dim], "rate": "4 mg/s", "radius": 0.1}


def gas(dim: int, **kinds: str) -> dict[str, object]:
    """Return a mixture; kinds: kind of gas by species."""
    parts = [
        {"kind": kind, "species": name, "sources": [source(0.5, 0.5 + 0.2 * n, dim)]}
        for n, (name, kind) in enumerate(kinds.items())
    ]
    return {"kind": "mixture", "parts": parts} if len(parts) > 1 else parts[0]


BOX = {"kind": "box", "center": [1.1, 0.6, 0.2], "size": [0.2, 0.2, 0.4]}
HEAT = {
    "reference": "21 degC",
    "walls": [{"face": "x-", "temperature": "26 degC", "transfer": "9 W/(m^2 K)"}],
    "heaters": [{"position": [0.8, 0.6, HEIGHT], "radius": "20 cm", "power": "60 W"}],
}
CASES: dict[str, dict[str, Any]] = {
    "two gases in 2-D": {"domain": FLAT, "gas": gas(2, ethanol="eulerian", acetone="eulerian")},
    "two gases beside an obstacle": {
        "domain": HIGH, "gas": gas(3, ethanol="eulerian", acetone="eulerian"), "obstacles": [BOX],
        "wind": {"kind": "synthetic"},
    },
    "puffs in 2-D": {"domain": FLAT, "gas": gas(2, acetone="puffs")},
    "puffs in 3-D": {"domain": HIGH, "gas": gas(3, acetone="puffs")},
    "puffs beside cells": {"domain": HIGH, "gas": gas(3, ethanol="puffs", acetone="eulerian")},
    "heated room": {
        "domain": HIGH, "gas": gas(3, ethanol="eulerian"), "warm_up": 3,
        "wind": {"kind": "cfd", "buoyancy": {"heat": HEAT}},
    },
}  # fmt: skip


def scenario(case: str) -> dict[str, Any]:
    dim = len(CASES[case]["domain"]["size"])
    height = {"height": HEIGHT} if dim == 3 else {}
    robots = {
        "name": "team", "count": 1, "start": {"kind": "positions", "positions": [[1.4, 0.3]]},
        "algorithm": {"kind": "casting"}, "sensors": {"gas": {"kind": "ideal", **height}},
    }  # fmt: skip
    wind = {"kind": "uniform", "velocity": [0.2, 0, 0][:dim]}
    recording = {"rate": 1, "wind_rate": 1, **({"slice_height": [HEIGHT]} if height else {})}
    common = {"duration": 4, "seed": 3, "stop_early": False, "wind": wind, "fields": {"rate": 1}}
    return common | {"robots": [robots], "recording": recording} | CASES[case]


@pytest.fixture(scope="module", params=CASES)
def seen(request, tmp_path_factory, taichi):
    """Return a run, the same run without fields, and the simulation at the run's end."""
    folder = tmp_path_factory.mktemp("run")
    run = tp.simulate(scenario(request.param), out=folder / "run", progress=False)
    shutil.copytree(run.folder, folder / "bare")
    shutil.rmtree(folder / "bare" / "fields.zarr")
    with tp.Simulation(scenario(request.param)) as sim:
        sim.run(until=4)
        yield run, tp.open_run(folder / "bare"), sim


def solved(sim: TimeLoop, name: str, x: float, y: float) -> float:
    """Return a gas [ppm] or the temperature [K] in the slice, by the solver's state: linear between layers of cells."""
    here = np.array([x, y, HEIGHT][: sim.grid.dim])
    if name == "temperature":
        cells = sim.grid.read(sim.wind.heat.theta) + sim.wind.heat.reference
    else:
        (n,) = (n for n, each in enumerate(sim.gas.species) if each.name == name)
        if sim.gas.gases[n].finer_than_cells:
            return float(fields.excess_at(sim.gas, here[None], sim.t)[0, n])
        density = sim.gas.gases[n].cells(sim.t)
        assert density is not None
        cells = density * sim.gas.species[n].ppm_per_density
    i, j = (int(value / sim.grid.dx) for value in (x, y))
    if sim.grid.dim == 2:
        return float(cells[i, j])
    below = HEIGHT / sim.grid.dx - 0.5
    k = int(below)
    return float(cells[i, j, k] + (below - k) * (cells[i, j, k + 1] - cells[i, j, k]))


def cloud_at(points: dict[str, np.ndarray], x: float, y: float) -> float:
    z = points["z"]
    n = np.argmin(np.hypot(points["x"] - x, points["y"] - y))
    assert points["x"][n] == pytest.approx(x, abs=1e-5)
    assert points["y"][n] == pytest.approx(y, abs=1e-5)
    assert z[n] == pytest.approx(HEIGHT, abs=1e-5) or not z.any()
    return float(list(points.values())[3][n])


def bag(folder: Path) -> dict[str, dict[str, np.ndarray]]:
    """Return the last cloud of each topic of a bag."""
    pytest.importorskip("rosbags")
    from rosbags.highlevel import AnyReader

    found = {}
    with AnyReader([folder]) as reader:
        for one, _, data in reader.messages():
            if one.topic.startswith("/plume/"):
                found[one.topic[1:]] = ros.points_of(reader.deserialize(data, one.msgtype))
    return found


def test_one_place_and_time_has_one_number(seen, tmp_path):
    run, bare, sim = seen
    last = run.pictures.isel(time=-1)
    assert float(last.time) == 4.0
    tp.export(bare.folder, to="netcdf", source="recording", out=tmp_path / "pictures.nc")
    tp.export(bare.folder, to="mcap", out=tmp_path / "bag", least=0.0)
    clouds = bag(tmp_path / "bag")
    live = {
        each.topic: ros.points_of(each.make())
        for each in Scene(sim.loop).messages()
        if each.name == ros.POINTS
    }  # type: ignore[arg-type]
    slices = {
        str(of.attrs.get("species", "temperature")): str(name)
        for name, of in last.data_vars.items()
        if of.attrs["view"] == "slice" and ("species" in of.attrs or of.attrs["quantity"] == "temperature")
    }
    assert set(slices) == {each.name for each in sim.loop.gas.species} | (
        {"temperature"} if sim.loop.scenario.heat else set()
    )
    for name, picture in slices.items():
        values = last[picture]
        found = values.where(np.isfinite(values), -np.inf).argmax(...)
        where = {dim: float(values[dim][index]) for dim, index in found.items()}
        x, y = (next(at for dim, at in where.items() if str(dim)[0] == axis) for axis in "xy")
        at = [x, y, HEIGHT][: sim.loop.grid.dim]
        expected = solved(sim.loop, name, x, y)
        with xarray.open_dataset(tmp_path / "pictures.nc") as data:
            netcdf = float(data[picture].isel(time=-1).sel(where))
        drawn = run.plot(view="slice", of=picture.removesuffix("_slice"), wind=False).axes[0].images[0]
        rows, columns = drawn.get_array().shape[:2]
        left, right, bottom, top = drawn.get_extent()
        up = (y - bottom) / (top - bottom) if drawn.origin == "lower" else (top - y) / (top - bottom)
        pixel = int(up * rows), int((x - left) / (right - left) * columns)
        numbers = {
            "pictures": float(values.sel(where)),
            "NetCDF": netcdf,
            "bag": cloud_at(clouds[f"plume/{name}"], x, y),
            "topic": cloud_at(live[f"plume/{name}"], x, y),
        }
        if name != "temperature":
            numbers["gas_at of pictures"] = float(bare.gas_at(*at)[f"{name}_ppm"][-1])
            (of,) = (each for each in sim.loop.gas.gases if each.species.name == name)
            if not of.finer_than_cells:
                numbers["gas_at of fields"] = float(run.gas_at(*at)[f"{name}_ppm"][-1])
        about = values.attrs
        allowed = (
            about["relative_precision"] * abs(expected) + about["absolute_precision"] + 1e-5 * abs(expected)
        )
        assert expected > 20 * allowed
        assert numbers == {who: pytest.approx(expected, abs=allowed) for who in numbers}, name
        low, high, byte = about["colors_from"], about["colors_to"], float(drawn.get_array()[pixel])
        position = (
            np.log(expected / low) / np.log(high / low)
            if about["colors"] == "log"
            else (expected - low) / (high - low)
        )
        assert byte == pytest.approx(255 * np.clip(position, 0, 1), abs=0.5 + 255 * allowed / expected), (
            "256 colours"
        )
