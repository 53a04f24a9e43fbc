"""Drones in recorded volumes of air: banks against the air itself, and the same flight as in an ordinary run."""

import copy
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml
from small_task import TASK

from taichi_plume.agents.sensors import Sensors
from taichi_plume.agents.swarm import Swarm
from taichi_plume.assembly.assemble import build
from taichi_plume.assembly.preparation import checked
from taichi_plume.cli.envs import main
from taichi_plume.engine import ti
from taichi_plume.envs import bank as banks
from taichi_plume.envs.episodes import Episodes
from taichi_plume.envs.picture import picture
from taichi_plume.grid.fields import Wind, ppm_at, velocity_at
from taichi_plume.scenario.loading import ScenarioError, scenario_from
from taichi_plume.scenario.species import SPECIES

pytestmark = pytest.mark.usefixtures("taichi")

SIZE, COARSE, COUNT, TICKS = (2.0, 1.2, 1.0), 0.2, 6, 5
WIND, LEVEL = [0.2, 0.1, -0.05, 0.1], [20.0, 5.0, 8.0, 12.0]  # value at 0 and slopes along x, y, z
LOW, HIGH = 0.2, 0.8
SOURCE = {"kind": "meandering", "species": "acetone", "width_slope": 0.1}
DRONES: dict[str, Any] = {
    **TASK,
    "domain": {"size": list(SIZE), "spacing": 0.1},
    "wind": {"kind": "uniform", "velocity": [0.5, 0.0, 0.0], "gusts": {"intensity": 0.3, "time": 1.0}},
    "gas": {**SOURCE, "sources": [{"position": [0.4, 0.5, 0.7], "rate": "10 mg/s", "radius": 0.05}]},
    "robots": [
        {
            "name": "drones",
            "count": 2,
            "start": {
                "kind": "area",
                "low": [0.7, 0.3],
                "high": [1.6, 0.9],
                "altitude": LOW,
                "highest": HIGH,
            },
            "algorithm": {
                "kind": "policy",
                "observe": ["gas", "wind", "height", "action", "mates"],
                "period": 0.1 * TICKS,
            },
            "body": {"kind": "crazyflie", "max_speed": 0.4, "max_climb": 0.3, "max_descent": 0.2},
            "sensors": {
                "gas": {"kind": "ideal", "height": 0.05},
                "wind": {"kind": "ideal", "height": 0.1},
            },
            "reach": 0.15,
        }
    ],
    "task": {"episode": 4.0, "film": 6.0, "spacing": COARSE, "heights": [0.2, 1.0], "mirror": False},
}


def linear(numbers):
    """(nx, ny, nz): linear in x, y and z at the cell centres of a film, in layers from 0.2 m on."""
    axes = [COARSE * (np.arange(round(length / COARSE)) + 0.5) for length in SIZE]
    x, y, z = np.meshgrid(axes[0], axes[1], axes[2][1:], indexing="ij")
    return numbers[0] + numbers[1] * x + numbers[2] * y + numbers[3] * z


def recorded() -> Any:
    """A film of air that stands still in time but is linear in space, with two sources one above the other."""
    values = np.stack([linear(WIND), linear(WIND[::-1]), linear(LEVEL)], axis=-1).astype(np.float16)
    return SimpleNamespace(
        values=np.repeat(values[None, None], 13, axis=1),
        scale=np.ones((1, 1), np.float32),
        air=np.ones((2, *values.shape[:3])),
        spacing=COARSE,
        low=0.2,
        frame=0.5,
        species=(SPECIES["acetone"],),
        sources=((np.array([[0.4, 0.6, 0.2], [0.4, 0.6, 0.7]]),),),
        films=1,
        length=6.0,
    )


@pytest.fixture(scope="module")
def engine(taichi):
    return Episodes(scenario_from(DRONES), count=COUNT, robots=2, bank=recorded())


class Air(Wind):
    """Air that is linear in space, with the numbers of the film."""

    species = (SPECIES["acetone"],)

    def advance(self, t, dt):
        pass

    @ti.func
    def velocity(self, x, t):
        a, b, c, d = ti.static(WIND)
        return ti.Vector([a + b * x[0] + c * x[1] + d * x[2], d + c * x[0] + b * x[1] + a * x[2], 0.0])

    @ti.func
    def ppm(self, x, t):
        a, b, c, d = ti.static(LEVEL)
        return ti.Vector([a + b * x[0] + c * x[1] + d * x[2]])


@pytest.mark.slow
def test_drones_fly_and_sense_as_in_an_ordinary_run(engine):
    """The same commands in the same air: ways, altitudes, readings and winds are the same."""
    engine.autoreset = "disabled"
    engine.reset(np.arange(COUNT, dtype=np.uint64))
    swarm = engine.swarm
    begun = swarm.altitude.to_numpy()
    assert LOW <= begun.min() < begun.max() <= HIGH
    assert engine.action_names == ("speed", "turn", "climb")
    assert engine.observations[:, engine.names.index("height")] == pytest.approx(begun / SIZE[2], abs=1e-6)
    model = swarm.groups[0].model
    starts = swarm.position.to_numpy(), swarm.heading.to_numpy()
    plain = Swarm([model], *starts, swarm.clearance, np.empty((0, 3)), 3)
    plain.altitude.from_numpy(begun)
    sensors, air = Sensors(plain, 3, 0.1, Air.species), Air()
    plain.move(1, 0.1, 0.1)
    sensors.measure(air, air, 1, 0.1)
    tick, rng = 1, np.random.default_rng(1)
    for _ in range(4):
        actions = rng.uniform(-1.0, 1.0, (2 * COUNT, 3)).astype(np.float32)
        engine.step(actions)
        plain.speed_command.from_numpy(0.5 * (1.0 + actions[:, 0]) * np.float32(0.4))
        plain.turn_rate_command.from_numpy(actions[:, 1] * plain.max_turn_rate.to_numpy())
        plain.climb_command.from_numpy(
            actions[:, 2] * np.where(actions[:, 2] > 0, 0.3, 0.2).astype(np.float32)
        )
        for _ in range(TICKS):
            tick += 1
            plain.move(tick, 0.1 * tick, 0.1)
            sensors.measure(air, air, tick, 0.1 * tick)
    known, wanted = swarm.snapshot(), plain.snapshot()
    assert not known["found"].any()
    for name in ("position", "heading", "altitude", "path_length"):
        np.testing.assert_allclose(known[name], wanted[name], atol=1e-5, err_msg=name)
    assert np.abs(known["altitude"] - begun).max() > 0.1
    inner = (np.abs(known["position"] - np.array(SIZE[:2]) / 2) < np.array(SIZE[:2]) / 2 - 0.1).all(axis=1)
    inner &= (known["altitude"] > 0.26) & (known["altitude"] < 0.79)
    assert inner.any()
    for name in ("true_ppm", "wind"):
        np.testing.assert_allclose(known[name][inner], wanted[name][inner], rtol=2e-3, err_msg=name)


def test_a_source_is_reached_in_space(engine):
    """Of two drones above the sources, the one at the height of a source finds it; rewards and state are in space."""
    engine.autoreset = "disabled"
    engine.reset(np.arange(COUNT, dtype=np.uint64))
    place, low = engine.swarm.position.to_numpy(), engine.swarm.altitude.to_numpy()
    place[:4] = [[0.4, 0.6], [1.5, 0.6], [0.4, 0.6], [1.5, 0.6]]
    low[[0, 2]] = [0.7, 0.45]
    engine.swarm.position.from_numpy(place)
    engine.swarm.altitude.from_numpy(low)
    truth, state = engine.read_truth(), engine.state()
    assert truth["source_position"][0] == pytest.approx([0.4, 0.6, 0.7])
    assert truth["source_offset"][0, 2] == pytest.approx(0.7 - 0.7 - 0.029 / 2, abs=1e-6)
    assert truth["source_offset"][2, 2] == pytest.approx(0.7 - 0.45 - 0.029 / 2, abs=1e-6)
    row = state[1].reshape(2, 9)[0]
    assert row[:3] == pytest.approx([0.4 / 1.0 - 1.0, 0.0, 2 * (0.45 + 0.0145) - 1.0], abs=1e-5)
    assert row[6:] == pytest.approx([0.4 / 1.0 - 1.0, 0.0, 0.4], abs=1e-5)
    engine.step(np.tile(np.array([-1.0, 0.0, 0.0], np.float32), (2 * COUNT, 1)))
    assert engine.terminated.tolist() == [True] + [False] * (COUNT - 1)
    assert engine.info["distance_m"][1] == pytest.approx(0.7 - 0.4645, abs=1e-4)
    assert picture(engine, 0).shape == (240, 400, 3)


@pytest.mark.slow
def test_a_volume_holds_the_means_of_its_blocks(tmp_path):
    """Against the air at the centres of the cells of the domain, and after it was written and read."""
    scenario = scenario_from(DRONES)
    bank = banks.record(scenario)
    (air, *_) = banks.airs(scenario)
    sim = build(checked(air, Path()))
    sim.run()
    points = sim.grid.centers()[:, :, 2:10]
    blocks = (10, 2, 6, 2, 4, 2)
    gas = ppm_at(sim.gas, points, sim.t)[..., 0].reshape(blocks).mean(axis=(1, 3, 5))
    wind = velocity_at(sim.wind, points, sim.t)[..., :2].reshape(*blocks, 2).mean(axis=(1, 3, 5))
    assert bank.values.shape[2:] == (10, 6, 4, 3)
    assert (bank.spacing, bank.low) == pytest.approx((COARSE, 0.2))
    np.testing.assert_allclose(bank.values[0, -1, ..., 2] * bank.scale[0, 0], gas, rtol=2e-3, atol=1e-4)
    np.testing.assert_allclose(bank.values[0, -1, ..., :2], wind, atol=1e-3)
    bank.write(tmp_path / "bank.zarr")
    again = banks.bank_of(scenario, Path(), tmp_path / "bank.zarr")
    np.testing.assert_array_equal(again.values, bank.values)
    assert again.low == bank.low
    assert again.sources[0][0].tolist() == [[0.4, 0.5, 0.7]]
    for other in ({"spacing": 0.1}, {"heights": [0.3, 1.0]}):
        with pytest.raises(ValueError, match="recorded of another scenario"):
            banks.bank_of(scenario_from(DRONES | {"task": DRONES["task"] | other}), Path(), bank)


def test_a_domain_that_is_no_multiple_has_smaller_blocks_at_its_ends():
    task = {**DRONES["task"], "spacing": 0.3, "heights": None, "film": 4.0, "frame": 2.0}
    bank = banks.record(scenario_from(DRONES | {"task": task}))
    assert bank.values.shape[2:5] == (7, 4, 4)
    assert bank.air.all()
    assert (bank.values[..., 0] > 0.1).any(axis=(0, 1)).all()


@pytest.mark.parametrize(
    ("keys", "reported"),
    [
        ({"spacing": 0.05}, r"task.spacing: 0.05 m; must be from domain.spacing = 0.1 m to 1 m"),
        ({"heights": [0.5, 0.4]}, r"task.heights: 0.5 to 0.4 m; must rise"),
        ({"heights": [0.5, 1.4]}, r"task.heights: 0.5 to 1.4 m; .* ceiling at 1 m"),
    ],
)
def test_bad_volumes_are_refused_in_a_line(keys, reported):
    with pytest.raises(ScenarioError, match=reported) as error:
        checked(scenario_from(DRONES | {"task": DRONES["task"] | keys}), Path())
    assert len(error.value.faults) == 1


def test_the_check_states_that_films_hold_no_downwash():
    wind = {
        "kind": "cfd",
        "openings": [{"kind": "inlet", "face": "x-", "speed": 0.3}, {"kind": "outlet", "face": "x+"}],
    }
    gas = {"kind": "eulerian", "sources": [{"position": [0.4, 0.5, 0.7], "rate": "1 mg/s", "radius": 0.1}]}
    robots = [DRONES["robots"][0] | {"wake": True, "algorithm": {"kind": "policy"}}]
    scenario = scenario_from(DRONES | {"wind": wind, "gas": gas, "robots": robots})
    lines = checked(scenario, Path()).resources.warnings
    assert sum("task: " in line and "downwash of 'drones'" in line for line in lines) == 1


@pytest.mark.parametrize(
    ("path", "value", "reported"),
    [
        (("start", "highest"), 0.99, r"start.highest: 0.99 m and .* ceiling"),
        (("start", "highest"), 0.1, r"start.highest: 0.1 m; must be at least 0.2 m"),
        (("body",), {"kind": "free"}, r"is for drones"),
    ],
)
def test_bad_starts_in_space_are_refused(path, value, reported):
    section = copy.deepcopy(DRONES)
    part: Any = section["robots"][0]
    for key in path[:-1]:
        part = part[key]
    part[path[-1]] = value
    with pytest.raises(ScenarioError, match=reported):
        checked(scenario_from(section), Path())


def test_the_command_states_the_size_first_and_refuses_too_much_in_a_line(tmp_path, capsys):
    file = tmp_path / "task.yaml"
    file.write_text(yaml.safe_dump(DRONES))
    long = ["--set", "task.film=360000", "--set", "task.airs=1000"]
    assert main([str(file), "--out", str(tmp_path / "bank.zarr"), *long]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    assert all(word in lines[0] for word in ("10 x 6 x 4 cells", "task.heights", "task.spacing"))
    short = ["--set", "task.film=4", "--set", "task.frame=2", "--set", "task.airs=1"]
    assert main([str(file), "--out", str(tmp_path / "bank.zarr"), *short]) == 0
    said = capsys.readouterr()
    assert "of 10 x 6 x 4 cells" in said.err.splitlines()[0]
    assert "MB on disk" in said.out
