"""Runs in a background of gas: searches, maps and films count above it, sensors and probes measure all gas."""

import json
from typing import Any

import numpy as np
import pytest

import taichi_plume as tp
from taichi_plume.cli.maps import main as maps_command
from taichi_plume.envs.episodes import Episodes
from taichi_plume.scenario.loading import ScenarioError, scenario_from

pytestmark = pytest.mark.usefixtures("taichi")

CO2 = 420.0


def scenario(dim: int = 2, **changes: Any) -> dict[str, Any]:
    """Two robots that search for a leak of carbon dioxide, and a map."""
    height = [1.0] * (dim - 2)
    return {
        "seed": 4,
        "duration": 12,
        "domain": {"size": [4, 3, *height], "spacing": 0.1},
        "wind": {"kind": "uniform", "velocity": [0.3, 0, 0][:dim]},
        "gas": {
            "kind": "gaussian_plume",
            "species": "carbon_dioxide",
            "intensity": 0.1,
            "sources": [{"position": [0.5, 1.5, *([0.1] * (dim - 2))], "rate": "20 mg/s", "radius": 0.1}],
        },
        "robots": [
            {
                "name": "pair",
                "count": 2,
                "start": {"kind": "positions", "positions": [[3.5, 1.4], [3.5, 2.5]], "heading_deg": 180},
                "algorithm": {"kind": "casting", "threshold_ppm": 1},
                "sensors": {"gas": {"kind": "ideal"}},
            }
        ],
        "maps": [{"kind": "gmrf", "cell": 0.2}],
    } | changes


def run(folder, data, **overrides: Any):
    return tp.simulate(
        data, overrides={key.replace("__", "."): of for key, of in overrides.items()}, out=folder
    )


ALGORITHMS = ("casting", "spiral", "infotaxis", "ecoli", "dapso", "surge_spiral")


@pytest.mark.slow
@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_a_search_is_the_same_with_a_background_as_without(tmp_path, algorithm):
    data = scenario(maps=[], stop_early=False, duration=20)
    data["robots"][0]["algorithm"] = {"kind": algorithm}
    data["robots"][0]["sensors"]["gas"]["noise_ppm"] = 0.5
    alone = run(tmp_path / "alone", data).robots
    both = run(tmp_path / "both", data, gas__background=CO2).robots
    for name in ("x", "y", "heading"):
        np.testing.assert_allclose(both[name], alone[name], atol=1e-3, err_msg=name)
    assert both.state.eq(alone.state).all()
    assert np.hypot(np.ptp(alone.x), np.ptp(alone.y)) > 0.1
    later = alone.t > 0
    assert (np.abs(both.true_ppm - alone.true_ppm - CO2) < 1e-3)[later].all()
    felt = alone.reading_ppm > 0  # else noise may have been cut at 0
    np.testing.assert_allclose(
        both.reading_ppm[felt & later] - CO2, alone.reading_ppm[felt & later], atol=1e-3
    )


@pytest.fixture(scope="module", params=[2, 3])
def runs(request, tmp_path_factory):
    """The same run without and with a background, and the folder of the second."""
    folder, dim = tmp_path_factory.mktemp("background"), request.param
    place = [2.0, 1.5, *([0.3] * (dim - 2))]
    probes = {"every": 0.25, "points": [{"kind": "point", "name": "mast", "at": place}]}
    data = scenario(dim, duration=5, fields={"rate": 1}, probes=probes)
    alone = run(folder / "alone", data)
    return alone, run(folder / "both", data, gas__background=CO2), folder, place, dim


@pytest.mark.slow
def test_maps_and_fields_are_above_the_background_probes_and_gas_at_are_not(runs):
    alone, both, _, place, _ = runs
    name = "carbon_dioxide_ppm"
    np.testing.assert_array_equal(both.fields[name].values, alone.fields[name].values)
    assert both.fields[name].attrs["background_ppm"] == CO2
    assert "background_ppm" not in alone.fields[name].attrs
    np.testing.assert_allclose(both.probes[name] - CO2, alone.probes[name], atol=1e-3)
    assert alone.probes[name].max() > 1.0
    at, clean = both.gas_at(*place)[name], alone.gas_at(*place)[name]
    np.testing.assert_allclose(at - CO2, clean, atol=1e-3)
    assert "background_ppm" not in at.attrs
    (of_alone,), (of_both,) = alone.maps, both.maps
    np.testing.assert_allclose(of_both.estimate, of_alone.estimate, atol=1e-3)
    np.testing.assert_array_equal(of_both.truth, of_alone.truth)
    assert json.loads(of_both.attrs["background_ppm"]) == {"carbon_dioxide": CO2}
    scores = [one.result["maps"][0]["mae_ppm"] for one in (alone, both)]
    assert scores[1] == pytest.approx(scores[0], rel=1e-4)


@pytest.mark.slow
def test_statistics_of_probes_count_from_the_background_on(runs):
    from taichi_plume.fluctuations.records import ProbeRecord

    alone, both, *_ = runs
    values = [
        ProbeRecord(one.folder / "probes.parquet").values(np.array([0]), "carbon_dioxide_ppm")
        for one in (alone, both)
    ]
    np.testing.assert_allclose(values[1], values[0], atol=1e-3)


@pytest.mark.slow
def test_playback_adds_the_recorded_background_once(runs):
    _, both, folder, place, dim = runs
    data = scenario(dim, duration=3, maps=[], probes=both.scenario.probes.model_dump(mode="json"))
    film = {"kind": "playback", "file": "both/fields.zarr"}
    data |= {"gas": film, "wind": {"kind": "uniform", "velocity": [0.3, 0, 0][:dim]}}
    expected = float(both.gas_at(*place)["carbon_dioxide_ppm"][0])
    for given, background in ({}, CO2), ({"background": 300}, 300.0), ({"background": 0}, 0.0):
        path = folder / "again.yaml"
        path.write_text(json.dumps(data | {"gas": film | given}))
        again = tp.simulate(path, out=folder / "again", force=True)
        found = again.probes["carbon_dioxide_ppm"].iloc[0]
        assert found == pytest.approx(expected - CO2 + background, abs=0.01)
        assert again.scenario.backgrounds["carbon_dioxide"] == background


@pytest.mark.slow
def test_a_map_of_a_log_counts_above_its_background(runs, tmp_path, capsys):
    alone, both, *_ = runs
    of_alone = tp.maps(alone, "gmrf")
    of_both = tp.maps(both, "gmrf")
    np.testing.assert_allclose(of_both.estimate, of_alone.estimate, atol=1e-3)
    assert of_both.readings.reading.min() >= 0.0
    for table in (alone, both):
        assert ("above_ppm" in table.robots) == (table is both)
    np.testing.assert_allclose(both.robots.above_ppm, alone.robots.reading_ppm, atol=1e-3)
    assert (of_alone.scores["background_ppm"], of_both.scores["background_ppm"]) == (0.0, CO2)
    log = tmp_path / "log.csv"
    both.robots[["t", "x", "y", "reading_ppm"]].rename(columns={"reading_ppm": "reading"}).to_csv(
        log, index=False
    )
    options = ["--map", "gmrf", "--size", "4", "3", "--background", "420", "--out", str(tmp_path / "map")]
    assert maps_command([str(log), *options]) == 0
    assert "420 ppm" in capsys.readouterr().out
    assert json.loads((tmp_path / "map/scores.json").read_text())["background_ppm"] == CO2


@pytest.mark.slow
def test_a_replay_compares_whole_readings(runs):
    _, _, folder, _, dim = runs
    data = scenario(dim, duration=4, maps=[])
    data["gas"] |= {"background": CO2}
    data["robots"][0]["algorithm"] = {"kind": "replay", "file": "both/robots.parquet"}
    path = folder / "replay.yaml"
    path.write_text(json.dumps(data))
    result = tp.simulate(path, out=folder / "replay").result
    (group,) = result["groups"]
    assert group["beside_recorded"]["mae_ppm"] == pytest.approx([0.0], abs=1.0)


def test_statistics_compare_sensors_in_the_whole_gas():
    """A metal oxide reads the excess right in any background; linear whiffs, as without noise and lag."""
    from taichi_plume.fluctuations.sensor_comparison import readings
    from taichi_plume.scenario.sensors import IdealGasSensor, MoxSensor

    ppm = np.linspace(0.0, 40.0, 9)[:, None]
    ideal = IdealGasSensor(kind="ideal")
    mox = MoxSensor.model_validate(
        {"kind": "mox", "model": "tgs2611", "noise": 0, "rise_time": 0, "decay_time": 0, "bits": 12}
    )
    clean, above = (
        np.array(list(readings([ideal, mox], "methane", 0.1, ppm, background=of)))[:, :, 0]
        for of in (0.0, 500.0)
    )
    np.testing.assert_allclose(above[:, 0], ppm[:, 0], atol=1e-3)
    error = [np.abs(each[:, 1] - ppm[:, 0]).max() for each in (clean, above)]
    assert error[1] > 2.0 * error[0], "the converter resolves less of a high background"
    assert error[1] < 20.0


def test_a_change_acts_from_then_on():
    data = scenario(maps=[])
    data["gas"]["sources"][0]["rate"] = 0
    data["gas"]["background"] = CO2
    with tp.Simulation(data) as sim:
        sim.step(5)
        assert sim.robots.reading_ppm.min() == CO2
        with pytest.raises(ScenarioError, match=r"gas\.background.* 0 ppm"):
            sim.change({"gas.background": 0})
        sim.change({"gas.background": 400})
        sim.step(2)
        assert sim.robots.reading_ppm.min() == 400.0
        assert sim.gas["carbon_dioxide_ppm"].attrs["background_ppm"] == 400.0
        assert float(sim.gas["carbon_dioxide_ppm"].min()) == 0.0


def mixture(*backgrounds: Any) -> dict[str, Any]:
    plume = scenario()["gas"]
    plume["sources"][0]["rate"] = 0
    species = ("methane", "carbon_dioxide", "methane")
    each = zip(species, backgrounds, strict=True)
    return {"kind": "mixture", "parts": [plume | {"species": name, "background": ppm} for name, ppm in each]}


def test_gases_of_a_species_share_one_background():
    for backgrounds in ((1.9, CO2, 1.9), (1.9, CO2, 0), (0, CO2, 1.9)):
        found = scenario_from(scenario(gas=mixture(*backgrounds)))
        assert found.backgrounds == {"methane": 1.9, "carbon_dioxide": CO2}
        with tp.Simulation(found) as sim:
            sim.step()
            assert sim.robots.true_ppm.min() == pytest.approx(CO2 + 1.9, rel=1e-6)


@pytest.mark.parametrize(
    ("gas", "key", "texts"),
    [
        (mixture(1.9, CO2, 2.5), "gas.parts[2].background", ("2.5", "1.9", "gas.parts[0]")),
        (scenario()["gas"] | {"background": -1}, "gas.background", ("-1",)),
        (scenario()["gas"] | {"background": "3 kg"}, "gas.background", ("ppm",)),
    ],
)
def test_impossible_backgrounds_are_refused(gas, key, texts):
    with pytest.raises(ScenarioError) as refused:
        tp.load_scenario(scenario(gas=gas))
    (line,) = refused.value.lines
    assert line.startswith(key)
    assert all(text in line for text in texts)


def test_a_check_states_the_background():
    found = tp.Scenario.from_dict(scenario()).with_({"gas.background": "0.042 %"}).check()
    assert "420 ppm" in str(found)


def test_environments_observe_the_excess():
    data = scenario(maps=[], task={"episode": 3.0, "film": 4.0})
    data["robots"][0] |= {"count": 1, "algorithm": {"kind": "policy", "observe": ["gas"]}}
    data["robots"][0]["start"] = {"kind": "area", "low": [2, 1], "high": [3, 2]}
    seen, true = [], []
    for background in (0.0, CO2):
        model = scenario_from(data | {"gas": data["gas"] | {"background": background}})
        episodes = Episodes(model, count=8)
        episodes.reset(np.arange(8, dtype=np.uint64))
        for _ in range(5):
            episodes.step(np.zeros((8, episodes.action_size), np.float32))
        seen.append(episodes.observations.copy())
        true.append(episodes.read_truth()["true_ppm"].ravel())
    assert seen[0].max() > 0.0
    np.testing.assert_allclose(seen[1], seen[0], atol=1e-4)
    np.testing.assert_allclose(true[1] - CO2, true[0], atol=1e-3)


@pytest.mark.parametrize("gives", ["integral", "mean"])
def test_a_laser_reads_the_background_along_its_beam(gives):
    laser = {
        "kind": "tdlas",
        "species": "carbon_dioxide",
        "gives": gives,
        "noise_ppm_m": 0,
        "detection_limit_ppm_m": 0,
    }
    data = scenario(maps=[])
    data["gas"] |= {"background": CO2}
    data["gas"]["sources"][0]["rate"] = 0
    data["robots"][0] |= {"sensors": {"gas": laser}, "algorithm": {"kind": "casting", "speed": 0}}
    with tp.Simulation(data) as sim:
        for _ in range(3):
            sim.step()
            length = sim.loop.sensors.noses[0].length.to_numpy()
            way = length if gives == "integral" else np.ones(2)
            assert length == pytest.approx(3.5, rel=1e-4)
            np.testing.assert_allclose(sim.robots.reading_ppm, CO2 * way, rtol=1e-4)
            np.testing.assert_allclose(sim.loop.swarm.snapshot()["above_ppm"], 0.0, atol=0.05)
            np.testing.assert_allclose(sim.robots.true_ppm, CO2, rtol=1e-5)


def test_own_algorithms_read_the_excess_and_clients_the_whole():
    seen = []

    class Looking:
        def act(self, robots):
            seen.append(robots.reading.copy())

    data = scenario(maps=[])
    data["gas"] |= {"background": CO2}
    data["robots"][0]["algorithm"] = tp.Own(Looking)
    with tp.Simulation(data) as sim:
        sim.step(3)
        whole = sim.robots.reading_ppm.to_numpy()
    np.testing.assert_allclose(seen[-1], whole - CO2, atol=1e-3)
