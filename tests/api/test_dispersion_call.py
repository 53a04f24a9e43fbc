"""Dispersion on the recorded wind of a run."""

import numpy as np
import pytest

import taichi_plume as tp


@pytest.mark.slow
def test_mean_wind_of_a_run(tmp_path):
    """A uniform wind, recorded, is the wind of the model; all of the gas leaves with it."""
    scenario = {
        "duration": 4.0,
        "domain": {"size": [4.0, 2.0], "spacing": 0.1},
        "wind": {"kind": "uniform", "velocity": [0.3, 0.0]},
        "gas": {"kind": "eulerian", "sources": [{"position": [1.0, 1.0], "rate": "1 mg/s"}]},
    }
    run = tp.simulate(tp.load_scenario(scenario), out=tmp_path / "run")
    model = tp.dispersion(run, diffusivity=0.02)
    assert model.wind[..., 0] == pytest.approx(0.3, rel=0.01)
    assert np.abs(model.wind[..., 1]).max() < 0.01
    rates = 1e-6 * model.at((1.0, 1.0))
    c = model.concentration(rates)
    edge, outflow = model.edges
    assert model.area * (np.maximum(outflow, 0.0) * c.ravel()[edge]).sum() == pytest.approx(1e-6)


def test_an_array_needs_a_cell():
    with pytest.raises(ValueError, match="cell"):
        tp.dispersion(np.ones((4, 4, 2)))
