"""Maps over height in runs of drones: truth, files, scores, report, recording, and what refuses them."""

import numpy as np
import pytest
import yaml

import taichi_plume as tp
from taichi_plume.assembly.assemble import assemble
from taichi_plume.files import maps_file
from taichi_plume.files.readings import ReadingsError
from taichi_plume.grid.fields import ppm_at
from taichi_plume.report.maps import maps_of
from taichi_plume.scenario.loading import ScenarioError, scenario_from
from taichi_plume.scoring import trials as scores

pytestmark = [pytest.mark.usefixtures("taichi"), pytest.mark.slow]

SCENARIO = """
name: drones
duration: 12
domain: {size: [3.0, 2.0, 1.5], spacing: 0.1}
wind: {kind: uniform, velocity: [0.4, 0.0, 0.0]}
gas: {kind: gaussian_plume, intensity: 0.3, sources: [{position: [0.4, 1.0, 0.75], rate: 1.0e-6}]}
robots:
  - {name: high, count: 1, trials: 2, reach: 0, body: {kind: crazyflie}, algorithm: {kind: random_walk},
     start: {kind: area, low: [0.5, 0.9], high: [2.5, 1.7], altitude: 1.0}, sensors: {gas: {kind: ideal}}}
  - {name: low, count: 2, trials: 2, reach: 0, algorithm: {kind: random_walk},
     start: {kind: area, low: [0.5, 0.9], high: [2.5, 1.7]}, sensors: {gas: {kind: ideal, height: 0.3}}}
maps:
  - {kind: gmrf, cell: 0.25, layer: 0.5}
  - {kind: kernel_dmv, cell: 0.25, layer: 0.25, heights: [0.2, 1.2], sigma: 0.4}
  - {kind: gmrf, cell: 0.25}
"""


def sim(**keys):
    return assemble(scenario_from(yaml.safe_load(SCENARIO) | keys))


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("layers")
    (folder / "drones.yaml").write_text(SCENARIO)
    return tp.simulate(folder / "drones.yaml", out=folder / "run", report=True)


def test_files_have_the_height_and_the_truth_of_each_layer(run):
    field, kernel, flat = run.maps
    assert field.estimate.dims == field.truth.dims == field.variance.dims == maps_file.LAYERS
    assert field.measurable.dims == maps_file.LAYERS[1:]
    assert flat.estimate.dims == maps_file.WHOLE
    np.testing.assert_allclose(field.z, [0.25, 0.75, 1.25])
    np.testing.assert_allclose(kernel.z, [0.325, 0.575, 0.825, 1.075])
    assert field.estimate.shape == (2, 3, 8, 12)


def test_readings_count_at_the_height_of_the_sensor(run):
    """The variance is least where the drone and the robots on the floor measure."""
    least = run.maps[0].variance.min(("y", "x"))
    altitude = run.robots[run.robots.group == "high"].z
    assert 0.95 < altitude.mean() < 1.05
    assert (least.sel(z=[0.25, 1.25]) < least.sel(z=0.75)).all()


def test_scores_and_summary(run):
    result = run.result["maps"]
    assert result[0]["layer_m"] == 0.5
    assert result[0]["heights_m"] == [0.0, 1.5]
    assert "layer_m" not in result[2]
    for each in result[:2]:
        assert len(each["mean_gas"]["nlpd"]) == 2
        assert np.isfinite(each["mean_gas"]["nlpd"][-1])
        assert each["mean_gas"]["peak_distance_m"][-1] < 3.0
    known = np.isfinite(run.maps[0].estimate[0].values) & (run.maps[0].measurable.values == 1)
    off = np.abs(run.maps[0].estimate[0].values - run.maps[0].truth[0].values)[known].mean()
    assert result[0]["mean_gas"]["per_trial_at_end"]["error_ppm"][0] == pytest.approx(off, rel=0.3)


def test_report_has_slices(run):
    names = [each.name for each in maps_of(run.folder)]
    assert names[:3] == [f"gmrf map, z = {z:g} m" for z in (0.25, 0.75, 1.25)]
    assert len(names) == 3 + 4 + 1


def test_logs_make_no_maps_over_height(run):
    with pytest.raises(ReadingsError, match=r"--map\.layer"):
        tp.maps(run, {"kind": "gmrf", "layer": 0.5})


@pytest.mark.parametrize(
    ("keys", "line"),
    [
        ({"layer": 1.6}, r"maps\[0\]\.layer: 1\.6 m .* 1\.5 m"),
        ({"heights": [0.0, 1.0]}, r"heights: needs layer"),
        ({"layer": 0.5, "heights": [0.4, 0.6]}, r"heights: from 0\.4 m to 0\.6 m"),
        ({"layer": 0.5, "heights": [0.4, 2.6]}, r"maps\[0\]\.heights: 2\.6 m .* 1\.5 m"),
        ({"layer": 0.001, "cell": 0.01}, r"maps\[0\]\.layer: 0\.001 m makes 90,000,000 .*4,000,000"),
        ({"layer": 0.02, "cell": 0.1}, r"maps\[0\]\.layer: 0\.02 m makes 600 .*400"),
    ],
)
def test_bad_layers_are_refused(keys, line):
    with pytest.raises(ScenarioError, match=line):
        sim(maps=[{"kind": "gmrf", "cell": 0.25} | keys])


def test_a_floor_has_no_layers():
    with pytest.raises(ScenarioError, match=r"maps\[0\]\.layer: needs a 3-D room"):
        sim(
            domain={"size": [3.0, 2.0], "spacing": 0.1},
            wind={"kind": "uniform", "velocity": [0.4, 0.0]},
            gas={
                "kind": "gaussian_plume",
                "intensity": 0.3,
                "sources": [{"position": [0.4, 1.0], "rate": 1e-6}],
            },
            robots=[],
            maps=[{"kind": "kernel_dmv", "layer": 0.5}],
        )


def test_the_truth_of_a_layer_is_the_mean_over_its_height():
    plume = sim()
    levels = plume.maps[0].levels
    truth = scores.true_gas(plume, 0.25, (12, 8), levels)
    axes = [(np.arange(n) + 0.5) * 0.025 for n in (120, 80, 60)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    fine = ppm_at(plume.gas, points.reshape(-1, 3), 0.0).sum(axis=-1).reshape(120, 80, 60)
    mean = fine.reshape(12, 10, 8, 10, 3, 20).mean(axis=(1, 3, 5))
    downwind = mean[4:] > 0.1
    assert downwind.sum() > 60
    np.testing.assert_allclose(truth[4:][downwind], mean[4:][downwind], rtol=0.15)


def test_cells_in_obstacles_do_not_count():
    box = {"kind": "box", "center": [2.0, 0.4, 0.3], "size": [0.6, 0.6, 0.6]}
    gas = {"kind": "eulerian", "sources": [{"position": [0.4, 1.0, 0.75], "rate": 1e-6}]}
    with_box = sim(obstacles=[box], wind={"kind": "synthetic"}, gas=gas)
    reached = scores.measurable(with_box, 0.25, (12, 8), with_box.maps[0].levels)
    place = with_box.maps[0].places()
    inside = (np.abs(place - box["center"]) < np.array(box["size"]) / 2).all(axis=-1)
    assert inside.sum() > 2
    np.testing.assert_array_equal(~reached, inside)
