"""Own laws of gas and wind: their values in the air, what is refused, and what studies and resumed runs need."""

import numpy as np
import pytest
import yaml

import taichi_plume as tp
from taichi_plume.files.own_class import OwnAlgorithmError
from taichi_plume.grid.state import State
from taichi_plume.scenario.loading import ScenarioError
from taichi_plume.studies.given_classes import GivenClass

pytestmark = pytest.mark.usefixtures("taichi")

SIZE = (3.0, 2.0)


def bump(points, t, peak=40.0):
    return peak * np.exp(-((points[:, 0] - 1 - 0.2 * t) ** 2)) * (1 + points[:, 1])


def swirl(points, t):
    """Curl of the stream function sin(pi x/3) sin(pi y/2), which is 0 on the walls, and a stream along x."""
    x, y = np.pi * points[:, 0] / SIZE[0], np.pi * points[:, 1] / SIZE[1]
    u = np.pi / SIZE[1] * np.sin(x) * np.cos(y)
    v = -np.pi / SIZE[0] * np.cos(x) * np.sin(y)
    return (1 + 0.1 * np.sin(t)) * np.stack([0.3 + 0.2 * u, 0.2 * v], axis=-1)


def simulation(gas=None, wind=None, **keys):
    return tp.Simulation(
        {
            "duration": 5,
            "domain": {"size": SIZE, "spacing": 0.1},
            "wind": wind or tp.Own(swirl),
            "gas": {"species": "methane", **(gas or tp.Own(bump))},
            **keys,
        }
    )


def test_the_gas_is_that_of_the_law_at_each_time():
    with simulation(tp.Own(bump, peak=70.0)) as sim:
        for t in (0.0, 1.5):
            sim.run(until=t)
            gas = sim.gas.methane_ppm
            x, y = np.meshgrid(gas.x, gas.y)
            expected = 70.0 * np.exp(-((x - 1 - 0.2 * t) ** 2)) * (1 + y)
            np.testing.assert_allclose(gas.transpose("y", "x"), expected, rtol=1e-5)


def test_sensors_read_both_laws():
    """The gas sensor is at a cell's centre, the anemometer there between faces, by a fine grid's error."""
    robot = {
        "name": "one",
        "count": 1,
        "start": {"kind": "positions", "positions": [[1.25, 0.85]]},
        "algorithm": {"kind": "random_walk", "speed": 0.0},
        "sensors": {"gas": {"kind": "ideal"}, "wind": {"kind": "ideal"}},
    }
    with simulation(robots=[robot]) as sim:
        sim.run(until=2.0)
        now, at = sim.robots.iloc[0], np.array([[1.25, 0.85]])
        assert now.true_ppm == pytest.approx(bump(at, 2.0)[0], rel=1e-4)
        assert (now.wind_x, now.wind_y) == pytest.approx(tuple(swirl(at, 2.0)[0]), abs=2e-3)


def test_the_wind_is_the_nearest_one_without_divergence():
    """A law without divergence stays as it is but for the cells' error; any other loses its divergence."""
    with simulation() as sim:
        sim.run(until=1.0)
        found = sim.loop.wind.diagnostics()
        assert found["correction"] < 5e-3
        assert found["max_divergence"] < 1e-5
    with simulation(wind=tp.Own(lambda points, t: points)) as sim:
        found = sim.loop.wind.diagnostics()
        assert found["correction"] > 0.3
        assert found["max_divergence"] < 1e-5


def test_velocities_may_be_given_by_component():
    """Numbers, arrays beside numbers, and a row for each point."""
    means = []
    for law in (
        lambda points, t: [0.2, 0.1],
        lambda points, t: (0.2 + 0 * points[:, 0], 0.1),
        lambda points, t: [[0.2, 0.1] for _ in points],
    ):
        with simulation(wind=tp.Own(law)) as sim:
            means.append((float(sim.wind.u.mean()), float(sim.wind.v.mean())))
    assert means == [pytest.approx((0.2, 0.1))] * 3


def test_gas_on_the_grid_is_carried_and_conserved():
    gas = {"kind": "eulerian", "sources": [{"position": [0.5, 1.0], "rate": 1e-5}]}
    with simulation(gas) as sim:
        sim.run(until=4.0)
        budget = sim.loop.gas.gases[0].budget()
        left = budget["emitted_kg"] - budget["in_domain_kg"] - budget["outflow_kg"]
        assert budget["emitted_kg"] == pytest.approx(4e-5)
        assert abs(left) < 1e-5 * budget["emitted_kg"]
        middle = float((sim.gas.methane_ppm * sim.gas.x).sum() / sim.gas.methane_ppm.sum())
        assert middle > 0.8


def test_a_state_is_restored():
    with simulation() as sim:
        state = State(sim.loop)
        saved = state.save()
        first = sim.gas.methane_ppm.values.copy()
        sim.run(until=2.0)
        later = sim.gas.methane_ppm.values.copy()
        state.restore(saved)
        gas = sim.loop.gas.gases[0]
        cells = gas.cells(0.0)
        assert cells is not None
        with_state = cells * gas.species.ppm_per_density
        np.testing.assert_allclose(with_state.T, first, rtol=1e-6)
        assert np.abs(later - first).max() > 1.0


def negative(points, t):
    return -points[:, 0]


def uneven(points, t):
    return np.zeros(7)


def ragged(points, t):
    return [np.zeros(2), np.zeros(3)]


def infinite(points, t):
    return np.where(points[:, 0] > 2.0, np.inf, 1.0)


def complex_(points, t):
    return 1j * points[:, 0]


def broken(points, t):
    return 1.0 / 0.0


REFUSED = [
    (negative, r"negative: returned -0.05 ppm at \(0.05, 0.05\) m, t = 0 s; must not be negative"),
    (uneven, r"uneven: returned the shape \(7,\), not \(600,\)"),
    (ragged, r"ragged: returned parts of different shapes, not \(600,\)"),
    (infinite, r"infinite: returned inf at \(2.05, 0.05\) m, t = 0 s, not finite numbers"),
    (complex_, r"complex_: returned complex"),
    (broken, r"line \d+: ZeroDivisionError"),
]


@pytest.mark.parametrize(("law", "message"), REFUSED)
def test_bad_values_are_refused(law, message):
    with pytest.raises(OwnAlgorithmError, match=message):
        simulation(tp.Own(law))


@pytest.mark.parametrize(
    ("section", "key"), [({"gas": tp.Own(bump, height=3)}, "gas"), ({"wind": tp.Own(swirl, peak=1)}, "wind")]
)
def test_parameters_that_a_law_does_not_take_are_refused(section, key):
    with pytest.raises(ScenarioError, match=rf"{key}\.parameters: .*'(height|peak)'"):
        simulation(**section)


class Waits:
    def act(self, robots):
        pass


def test_code_of_another_kind_is_refused():
    with pytest.raises(ScenarioError, match="gas: no class or function was given"):
        simulation(tp.Own(Waits))
    robots = [{"name": "one", "count": 1, "start": {"kind": "positions", "positions": [[1, 1]]}}]
    robots[0]["algorithm"] = tp.Own(bump)
    robots[0]["sensors"] = {"gas": {"kind": "ideal"}, "wind": {"kind": "ideal"}}
    with pytest.raises(ScenarioError, match="algorithm: no class or function was given"):
        simulation(robots=robots)
    with pytest.raises(ScenarioError, match="a function that is a law"):
        tp.Own(3)  # type: ignore[arg-type]


LAWS = """
def concentration(points, t):
    return 5.0


def streams(points, t, speed):
    return [speed, 0.0]


steady: object = lambda points, t: [0.1, 0.0]
"""


def test_files_are_executed_with_permission_alone(tmp_path):
    (tmp_path / "laws.py").write_text(LAWS)
    data = {
        "duration": 1,
        "domain": {"size": SIZE, "spacing": 0.1},
        "gas": {"kind": "mixture", "parts": [{"kind": "own", "file": "laws.py"}]},
        "wind": {"kind": "own", "file": "laws.py", "name": "streams", "parameters": {"speed": 0.2}},
    }
    (tmp_path / "own.yaml").write_text(yaml.safe_dump(data))
    with pytest.raises(ScenarioError, match=r"gas.parts\[0\].file: .* holds Python code"):
        tp.Simulation(tmp_path / "own.yaml")
    with tp.Simulation(tmp_path / "own.yaml", allow_code=True) as sim:
        assert float(sim.gas.ethanol_ppm.mean()) == pytest.approx(5.0)
        sim.change({"wind.parameters.speed": 0.3})
        sim.run(until=0.2)
        assert float(sim.wind.u.mean()) == pytest.approx(0.3)
    steady = {"wind.name": "steady", "wind.parameters": {}}
    assert tp.load_scenario(tmp_path / "own.yaml", overrides=steady).wind.name == "steady"
    run = tp.simulate(tmp_path / "own.yaml", out=tmp_path / "run", allow_code=True)
    assert "--allow-code" in (run.folder / "scenario.yaml").read_text().splitlines()[0]
    data["wind"]["name"] = "concentrations"
    (tmp_path / "own.yaml").write_text(yaml.safe_dump(data))
    with pytest.raises(
        ScenarioError, match="no function 'concentrations'; there are: concentration, streams"
    ):
        tp.load_scenario(tmp_path / "own.yaml")


def test_studies_send_laws_to_their_workers():
    given = GivenClass.of(bump)
    loaded = given.pickled.load()
    points = np.array([[1.0, 0.5], [2.0, 1.5]])
    np.testing.assert_array_equal(loaded(points, 1.0, peak=2.0), bump(points, 1.0, peak=2.0))
    assert given.digest != GivenClass.of(swirl).digest
