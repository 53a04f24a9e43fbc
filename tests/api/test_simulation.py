"""tp.Simulation: the steps of a run, the present air and robots, changes and files while it runs."""

import numpy as np
import pytest
import xarray as xr
from test_simulate import DATA

import taichi_plume as tp
from taichi_plume.files import run_tables

pytestmark = pytest.mark.usefixtures("taichi")


@pytest.fixture(scope="module")
def sim(taichi) -> tp.Simulation:
    return tp.Simulation(DATA, seed=3)


@pytest.mark.slow
def test_its_steps_are_those_of_a_run(sim, tmp_path):
    run = tp.simulate(DATA, seed=3, out=tmp_path / "run", progress=False)
    sim.reset()
    assert sim.t == -0.5
    sim.step(3)
    assert sim.t == -0.2
    sim.run(until=1.0)
    assert sim.t == 1.0
    columns = ["x", "y", "reading_ppm", "true_ppm"]
    then = run.robots[np.isclose(run.robots.t, 1.0)]
    np.testing.assert_array_equal(sim.robots[columns], then[columns])
    assert sim.robots.attrs["units"]["reading_ppm"] == "ppm"
    sim.run()
    assert sim.finished
    assert sim.t == 2.0
    before = sim.gas.ethanol_ppm
    sim.reset(seed=4)
    sim.reset(seed=3)
    sim.run()
    assert sim.gas.ethanol_ppm.equals(before)


def test_the_present_air_is_that_of_a_film(sim, tmp_path):
    sim.reset()
    sim.run(until=1.0)
    sim.write(tmp_path / "film.zarr", every=0.5)
    sim.write(tmp_path / "robots.parquet")
    sim.run(until=1.5)
    gas, wind = sim.gas, sim.wind
    sim.run()
    film = xr.open_zarr(tmp_path / "film.zarr", consolidated=True)
    np.testing.assert_allclose(film.time, [1.0, 1.5, 2.0])
    frame, air = film.isel(time=1), film.air > 0.99
    for now, name in ((gas, "ethanol_ppm"), (wind, "u"), (wind, "v")):
        a, b = now[name].where(air), frame[name].where(air)
        np.testing.assert_allclose(a, b, rtol=1e-4, atol=1e-5 * float(abs(b).max()))
    assert np.isnan(gas.ethanol_ppm.sel(x=1.25, y=0.35, method="nearest"))  # within the cylinder
    rows = run_tables.read(tmp_path / "robots.parquet")
    np.testing.assert_allclose(np.unique(rows["t"]), np.arange(1.0, 2.01, 0.1))


def test_functions_are_called_at_their_period_also_after_a_reset(sim):
    sim.reset()
    seen = []
    sim.every(0.5, lambda now: seen.append(now.t))
    sim.run()
    assert seen == pytest.approx([-0.5, 0.0, 0.5, 1.0, 1.5, 2.0])
    sim.reset()
    sim.run(until=0.0)
    assert seen[6:] == pytest.approx([-0.5, 0.0])


def test_a_change_holds_from_now_on(sim):
    """The flow through the room follows the inlet; what the source gives off, its rate."""
    sim.reset()
    sim.run(until=1.0)
    inlet, gas, start = [float(sim.wind.u[:, 0].mean())], sim.loop.gas.gases[0].budget(), sim.robots
    sim.change({"wind.openings.0.speed": 0.45, "gas.sources.0.rate": "30 mg/s"})
    np.testing.assert_array_equal(sim.robots.x, start.x)
    assert sim.t == 1.0
    sim.run()
    inlet.append(float(sim.wind.u[:, 0].mean()))
    assert inlet[1] / inlet[0] == pytest.approx(1.5, rel=0.02)
    emitted = sim.loop.gas.gases[0].budget()["emitted_kg"] - gas["emitted_kg"]
    assert emitted == pytest.approx(30e-6 * 1.0, rel=1e-3)
    with pytest.raises(tp.ScenarioError, match="sources"):
        sim.change({"gas.sources": []})
    assert sim.scenario.openings[0].speed == 0.45
    uniform = tp.Simulation(DATA | {"obstacles": [], "wind": {"kind": "uniform", "velocity": [0.3, 0.0]}})
    uniform.step()
    assert uniform.wind.u.max() == pytest.approx(0.3)
    uniform.change({"wind.velocity": [0.2, 0.0]})
    assert uniform.wind.u.max() == pytest.approx(0.2)


class Creep:
    """Drives at a constant speed; notes how often it decided."""

    decisions = 0

    def __init__(self, speed=0.1):
        self.speed = speed

    def act(self, robots):
        type(self).decisions += 1
        robots.speed[:] = self.speed


@pytest.mark.slow
def test_a_class_drives_robots(sim):
    driven = tp.Simulation(DATA, overrides={"robots.0.algorithm": tp.Own(Creep, speed=0.05)})
    driven.run(until=1.0)
    assert Creep.decisions >= 10
    assert driven.robots.x.to_numpy() != pytest.approx(1.5)
    with pytest.raises(tp.ScenarioError, match="act"):
        tp.Own(dict)
    with pytest.raises(tp.ScenarioError, match=r"robots\[0\]\.algorithm"):
        tp.Simulation(DATA, overrides={"robots.0.algorithm": {"kind": "own", "name": "Unknown"}})


def test_a_refused_reset_leaves_it_as_it_was(sim, tmp_path):
    sim.reset()
    sim.write(tmp_path / "robots.parquet")
    sim.run(until=0.5)
    with pytest.raises(tp.ScenarioError, match="sources"):
        sim.reset(overrides={"gas.sources": []})
    sim.run(until=1.0)
    sim.reset()
    assert run_tables.read(tmp_path / "robots.parquet")["t"].to_numpy().max() == pytest.approx(1.0)


def test_a_reset_takes_another_room(taichi):
    sim = tp.Simulation(DATA)
    ball = {"kind": "sphere", "center": [1.0, 0.5], "radius": 0.2}
    sim.reset(overrides={"obstacles": [ball], "domain.spacing": 0.05, "robots.0.trials": 3})
    assert sim.gas.ethanol_ppm.isnull().any()
    assert len(sim.loop.obstacles) == 1
    sim.run()
    assert len(sim.robots) == 6
    assert sim.plot() is not None


def test_it_shows_itself(sim):
    sim.reset()
    sim.run(until=0.5)
    assert "t = 0.5 of 2 s" in repr(sim)
    assert "data:image/png;base64," in sim._repr_html_()
    for view in ("column", "sideways"):
        with pytest.raises(tp.InputError, match="view"):
            sim.plot(view)


def test_wrong_use_is_one_error(sim, tmp_path):
    (tmp_path / "there.zarr").mkdir()
    links = [tmp_path / name for name in ("to_nothing.zarr", "to_nothing.parquet")]
    for link in links:
        link.symlink_to("nothing")
    for use, word in (
        (lambda: sim.write(tmp_path / "there.zarr"), "exists"),
        *((lambda link=link: sim.write(link), f"{link.name}: exists") for link in links),
        (lambda: sim.write(tmp_path / "film.csv"), r"\.parquet"),
        (lambda: sim.write(tmp_path / "film.zarr", every=0.01), "0.1 s"),
        (lambda: sim.every(0.0, print), "at least 1e-06 s"),
        (lambda: sim.every(1.0, 3), "function"),  # type: ignore[arg-type]
        (lambda: sim.temperature, "heat"),
    ):
        with pytest.raises(tp.InputError, match=word):
            use()
    assert {path.name for path in tmp_path.iterdir()} == {"there.zarr", *(link.name for link in links)}
    for name in ("twice.parquet", "twice.zarr"):
        sim.write(tmp_path / name)
        with pytest.raises(tp.InputError, match=f"{name}: exists"):
            sim.write(tmp_path / name)
    with tp.Simulation(DATA) as other:
        other.step()
        sim.step()  # two at once
    with pytest.raises(tp.InputError, match="closed"):
        other.step()
