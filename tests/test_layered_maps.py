"""Maps over height in runs of drones: truth, files, scores, report, recording, and what refuses them."""

import numpy as np
import pytest
import yaml

import taichi_plume as tp
from taichi_plume.files import maps_file
from taichi_plume.files.readings import ReadingsError
from taichi_plume.report.maps import maps_of
from taichi_plume.scenario.loading import ScenarioError

pytestmark = pytest.mark.usefixtures("taichi")

SCENARIO = """
name: drones
duration: 12
domain: {size: [3.0, 2.0, 1.5], spacing: 0.1}
wind: {kind: uniform, velocity: [0.4, 0.0, 0.0]}
gas: {kind: gaussian_plume, intensity: 0.3, sources: [{position: [0.4, 1.0, 0.75], rate: 1.0e-6}]}
obstacles: [{kind: box, center: [2.0, 0.4, 0.3], size: [0.6, 0.6, 0.6]}]
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


def scenario(**keys):
    return tp.Scenario.from_dict(yaml.safe_load(SCENARIO) | keys)


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
    # the plume is a Gaussian about the height of the source, so that its layer has the most gas
    mean = field.truth[0].mean(("y", "x")).values
    assert mean[1] > 2.0 * mean[0] == pytest.approx(2.0 * mean[2], rel=1e-3)
    # points in the box cannot be measured
    assert field.measurable.sel(z=0.25, x=1.875, y=0.375) == 0
    assert field.measurable.sel(z=0.75, x=1.875, y=0.375) == 1
    assert np.isnan(field.estimate.sel(z=0.25, x=1.875, y=0.375)).all()


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
        scenario(maps=[{"kind": "gmrf", "cell": 0.25} | keys])


def test_a_floor_has_no_layers():
    flat = yaml.safe_load(SCENARIO) | {
        "domain": {"size": [3.0, 2.0], "spacing": 0.1},
        "wind": {"kind": "uniform", "velocity": [0.4, 0.0]},
        "gas": {"kind": "gaussian_plume", "sources": [{"position": [0.4, 1.0], "rate": 1e-6}]},
        "obstacles": [],
        "robots": [],
        "maps": [{"kind": "kernel_dmv", "layer": 0.5}],
    }
    with pytest.raises(ScenarioError, match=r"maps\[0\]\.layer: needs a 3-D room"):
        tp.Scenario.from_dict(flat)
