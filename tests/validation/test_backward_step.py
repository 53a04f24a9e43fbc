"""The backward-facing step: the layer that comes in, what is read of a flow, and a short run of it on coarse cells."""

from typing import Any

import numpy as np
import pytest

from taichi_plume.scenario.winds import CfdWind
from taichi_plume.validation import backward_step as case
from taichi_plume.validation.measured_air import Times

pytestmark = [pytest.mark.usefixtures("taichi"), pytest.mark.slow]


def test_the_layer_that_comes_in_is_the_measured_one():
    """Its momentum thickness is that of the simulation of the same step: Re_theta 670 (Le, Moin & Kim 1997,
    doi:10.1017/S0022112096003941).
    """
    z = np.linspace(0.0, 2.5, 2001)
    u, _ = case.layer_before(z)
    theta = np.trapezoid(u * (1.0 - u), z)
    assert theta * case.REYNOLDS == pytest.approx(670, rel=0.05)
    assert z[np.argmax(u > 0.99)] == pytest.approx(case.LAYER, abs=0.1)
    wind = CfdWind.model_validate({"kind": "cfd"} | case.wind(cells=5))
    layer: Any
    above: Any
    layer, above = wind.openings[:2]
    assert layer.speed < 0.95 * above.speed < case.U0
    heights = case.H * (1.0 + z[z <= case.LAYER])
    found = (
        layer.speed
        * layer.profile._speeds(heights, heights)
        / np.mean(layer.profile._speeds(heights, heights))
    )
    np.testing.assert_allclose(found, case.U0 * u[z <= case.LAYER], atol=0.01 * case.U0)
    assert case.U0 * case.H / wind.viscosity == pytest.approx(case.REYNOLDS)
    assert 0.03 < layer.turbulence_intensity < 0.1
    assert above.turbulence_intensity == 0.0


def test_reattachment_of_a_known_flow():
    cells = 4
    x = np.arange((case.BEFORE + case.BEHIND) * cells) / cells - case.BEFORE
    mean = np.ones((len(x), 6 * cells))
    mean[:, 0] = np.where(
        x < 0, 0.0, np.where(x < 1.0, 0.02, 0.05 * (x - 6.3))
    )  # a corner eddy turns the other way
    assert case.reattachment(mean, cells) == pytest.approx(6.3)
    mean[:, 0] = -0.1
    assert np.isnan(case.reattachment(mean, cells))


def test_a_short_run_flows_around_the_step():
    cells = 3
    record = case.record(cells, seed=1, times=Times(0.1, 0.2, 0.1))
    assert record.mean.shape == (18 * cells, 6 * cells)
    inlets: Any = CfdWind.model_validate({"kind": "cfd"} | case.wind(cells)).openings[:2]
    inflow = sum(one.speed * np.prod(one.size) for one in inlets)
    inflow /= case.H * case.WIDTH
    np.testing.assert_allclose(record.mean.sum(axis=1) * record.dx, inflow, rtol=1e-3)
    assert np.abs(record.mean[1 : case.BEFORE * cells, :cells]).max() < 1e-6
    z, found, measured = case.behind(record.mean, cells, 6)
    assert len(z) == len(found) == len(measured) == 17
    (experiment,) = case.CASES
    reported = case.quantities(record, cells).keys()
    assert all(one.published.keys() | one.expected.keys() <= reported for one in experiment.conditions)
