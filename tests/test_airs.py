"""Whether another seed makes other air is as the scenario says: looked up in the air itself."""

import json
from typing import Any

import numpy as np
import pytest
import rerun as rr
import xarray
import yaml
from scripts import read_result

from taichi_plume.assembly.assemble import assemble
from taichi_plume.cli import run
from taichi_plume.grid import fields
from taichi_plume.report.facts import key_facts
from taichi_plume.results.run import Run
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.time_loop import TimeLoop

pytestmark = [pytest.mark.usefixtures("taichi"), pytest.mark.slow]

SOURCE = {"position": (0.3, 0.5), "rate": 1e-6}
EULERIAN = {"kind": "eulerian", "sources": [SOURCE]}
PUFFING = {"pulse": 0.2, "pause": 0.3}
STEADY = {"kind": "uniform", "velocity": (0.5, 0.0)}
GUSTS = STEADY | {"gusts": {"intensity": 0.2, "time": 0.5}}
INLET = {"kind": "inlet", "face": "x-", "speed": 0.5}
MEANDERING = {"kind": "meandering", "sources": [SOURCE]}


def cfd(inlet: dict[str, Any]) -> dict[str, Any]:
    return {"kind": "cfd", "openings": [inlet, {"kind": "outlet", "face": "x+"}]}


def room(wind: dict[str, Any], gas: dict[str, Any]) -> Scenario:
    keys = {"duration": 2.0, "domain": {"size": (1.0, 1.0), "spacing": 0.1}, "wind": wind, "gas": gas}
    return Scenario.model_validate(keys)


@pytest.mark.parametrize(
    ("wind", "gas"),
    [
        (STEADY, {"kind": "gaussian_plume", "intensity": 0.1, "sources": [SOURCE]}),
        (STEADY, {"kind": "plumesim_gaussian", "release_point": (0.3, 0.5)}),
        (STEADY, {"kind": "eulerian", "sources": [SOURCE | {"puffing": PUFFING | {"spread": 0.0}}]}),
    ],
)
def test_air_that_is_steady_or_regular_is_not_drawn(wind, gas):
    assert not room(wind, gas).air_by_chance


@pytest.mark.parametrize(
    ("wind", "gas", "drawn"),
    [
        (cfd(INLET), EULERIAN, False),
        (cfd(INLET | {"turbulence_intensity": 0.2}), EULERIAN, True),
        (STEADY, {"kind": "eulerian", "sources": [SOURCE | {"puffing": PUFFING}]}, True),
        (STEADY, {"kind": "puffs", "sources": [SOURCE], "fluctuation": 0.0}, True),
        (STEADY, {"kind": "plumesim_meandering", "release_point": (0.3, 0.5)}, True),
        (GUSTS, MEANDERING, True),
        ({"kind": "synthetic"}, EULERIAN, True),
    ],
)
def test_another_seed_makes_other_air_where_it_is_said_to(wind, gas, drawn):
    scenario = room(wind, gas)
    assert scenario.air_by_chance == drawn
    sim = assemble(scenario)

    def air() -> np.ndarray:
        sim.run()
        return fields.ppm_at(sim.gas, POINTS, sim.t)

    first = air()
    assert first.max() > 0.0
    for seeds, same in (({"seed": 8}, not drawn), ({"seed": 8, "air_seed": scenario.seed}, True)):
        sim.reset(scenario.model_copy(update=seeds))
        assert np.array_equal(air(), first) == same


SEARCH = yaml.safe_load("""
duration: 2.0
domain: {size: [1.0, 1.0], spacing: 0.1}
wind: {kind: uniform, velocity: [0.5, 0.0], gusts: {intensity: 0.2, time: 0.5}}
gas: {kind: puffs, sources: [{position: [0.3, 0.5], rate: 1.0e-6, puffing: {pulse: 0.2, pause: 0.3}}]}
robots:
  - count: 2
    start: {kind: area, low: [0.6, 0.1], high: [0.9, 0.9]}
    algorithm: {kind: casting, threshold_ppm: 5}
    sensors: {gas: {kind: mox, model: tgs2620}, wind: {kind: ultrasonic}}
""")
AXIS = np.linspace(0.05, 0.95, 19)
POINTS = np.stack(np.meshgrid(AXIS, AXIS, indexing="ij"), axis=-1)


def story(sim: TimeLoop) -> tuple[np.ndarray, np.ndarray]:
    """Wind and gas of all ticks, and what the robots went through."""
    air, robots = [], []
    while not sim.finished:
        sim.advance()
        air += [fields.ppm_at(sim.gas, POINTS, sim.t).ravel()]
        air += [fields.velocity_at(sim.wind, POINTS, sim.t).ravel()]
        robots += [np.ravel(values) for values in sim.swarm.snapshot().values()]
    return np.concatenate(air), np.concatenate(robots)


def test_the_seed_of_the_air_is_that_of_wind_and_gas_alone():
    one = Scenario.model_validate(SEARCH | {"seed": 5})

    def seeded(seed: int, air_seed: int | None) -> Scenario:
        return one.model_copy(update={"seed": seed, "air_seed": air_seed})

    fresh = {seeds: story(assemble(seeded(*seeds))) for seeds in ((2, 6), (2, 5))}
    sim = assemble(one)
    air, robots = story(sim)
    stories = {}
    for seeds in ((5, 5), (2, 5), (5, 6), (2, None)):
        sim.reset(seeded(*seeds))
        stories[seeds] = story(sim)
    same = {seeds: np.array_equal(its[0], air) for seeds, its in stories.items()}
    assert same == {(5, 5): True, (2, 5): True, (5, 6): False, (2, None): False}
    assert np.array_equal(stories[5, 5][1], robots, equal_nan=True)
    starts = {seeds: its[1][: robots.size // 20] for seeds, its in stories.items()}
    assert not np.array_equal(starts[2, 5], robots[: robots.size // 20], equal_nan=True)
    assert np.array_equal(fresh[2, 6][0], stories[5, 6][0])
    assert np.array_equal(fresh[2, 5][1], stories[2, 5][1], equal_nan=True)


def test_a_run_tells_both_seeds_where_it_tells_one(tmp_path):
    wanted = {"seed": 5, "air_seed": 77, "duration": 0.5, "wind": cfd(INLET), "fields": {"rate": 2}}
    wanted |= {"maps": [{"kind": "kernel_dmv", "cell": 0.2}]}
    (tmp_path / "a.yaml").write_text(json.dumps(SEARCH | wanted))
    folder = tmp_path / "run"
    assert run.main([str(tmp_path / "a.yaml"), "--out", str(folder), "--quiet"]) == 0
    content = read_result(folder)
    film = xarray.open_zarr(folder / "fields.zarr").attrs
    maps = json.loads((folder / "maps.zarr" / "zarr.json").read_text())["attributes"]
    for reported in (content, film, maps, yaml.safe_load((folder / "scenario.yaml").read_text())):
        assert (reported["seed"], reported["air_seed"]) == (5, 77)
    assert "seed 5 and air_seed 77" in film["history"]
    assert "# seed: 5\n# air_seed: 77\n" in (folder / "scenario.yaml").read_text()
    assert ("air seed", "77") in key_facts(Run(folder, lenient=True))
    reader = rr.chunk.RrdReader(str(folder / "recording.rrd"))
    assert reader.recordings()[0].recording_id == "run-5-77"
    run.main([str(tmp_path / "a.yaml"), "--out", str(tmp_path / "b"), "--quiet", "--set", "air_seed=null"])
    assert "air_seed" not in read_result(tmp_path / "b")
    assert "air_seed" not in (tmp_path / "b" / "scenario.yaml").read_text()
