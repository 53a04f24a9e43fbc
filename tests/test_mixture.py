"""Two vapours on one grid, from the scenario to the files of a run."""

from typing import Any

import numpy as np
import pytest
import zarr
from scripts import read_result

from taichi_plume.cli.run import main

pytestmark = pytest.mark.usefixtures("taichi")


SCENARIO = """
duration: 20.0
fields: {rate: 2.0}
stop_early: false
domain: {size: [1.6, 1.0], spacing: 0.05}
wind: {kind: cfd, openings: [{kind: inlet, face: x-, speed: 0.2}, {kind: outlet, face: x+}]}
gas:
  kind: mixture
  parts:
    - kind: eulerian
      species: ethanol
      sources:
        - {position: [0.4, 0.25], rate: 2.0e-6, radius: 0.1}
        - {position: [0.4, 0.3], rate: 1.0e-6, radius: 0.1}
    - {kind: eulerian, species: acetone, sources: [{position: [0.4, 0.75], rate: 4.0e-6, radius: 0.1}]}
robots:
  - name: team
    count: 2
    start: {kind: line, begin: [0.9, 0.25], end: [0.9, 0.75]}
    algorithm: {kind: casting, threshold_ppm: 1.0}
    sensors: {gas: {kind: mox, model: mics5524}, wind: {kind: ultrasonic}}
"""


@pytest.mark.slow
def test_a_run_tells_of_both(tmp_path):
    path, out = tmp_path / "both.yaml", tmp_path / "out"
    path.write_text(SCENARIO)
    assert main([str(path), "--out", str(out), "--arch", "cpu", "--quiet"]) == 0
    result = read_result(out)
    parts = result["gas"]["parts"]
    assert [part["species"] for part in parts] == ["ethanol", "acetone"]
    assert [part["emitted_kg"] for part in parts] == pytest.approx([6e-5, 8e-5])
    assert all(abs(part["relative_error"]) <= 1e-6 for part in (result["gas"], *parts))
    assert result["groups"][0]["per_trial"]["found"] == [2]  # one downwind of each
    film: Any = zarr.open(out / "fields.zarr", mode="r")
    for name, part in zip(("gas_ethanol", "gas_acetone"), parts, strict=True):
        mass = np.asarray(film[name][-1], float).sum() * 0.05**2
        assert mass == pytest.approx(part["in_domain_kg"], rel=1e-3)
    assert (out / "recording.rrd").stat().st_size > 10_000
