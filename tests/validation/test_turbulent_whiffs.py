"""The case of whiffs in turbulent air: its scales are those it tells, and it finds the exponent of walks that have one.

The case itself is solved with the slow ones, in test_cases.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from taichi_plume.assembly.preparation import checked
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.validation import turbulent_whiffs as case


def test_the_decade_lies_between_the_smallest_and_the_largest_eddies():
    scenario, resources = checked(Scenario.model_validate(case.scenario(1, 300.0)), Path())
    inlet: Any = scenario.wind.computed.openings[0]  # type: ignore[union-attr]
    assert scenario.domain.spacing * 16.0 / inlet.speed == pytest.approx(case.FIRST)
    assert 0.5 * inlet.turbulence_length / inlet.speed >= case.LAST
    puffs = scenario.gas.parts[1]
    assert 4.0 * puffs.initial_size / inlet.speed < case.FIRST / 2.0
    assert resources.warnings == []
    places = np.concatenate([one.places for one in scenario.probes.points])
    assert len(places) == len(case.DISTANCES) * case.ROWS * len(case.ACROSS)
    sources = np.array([one.position for one in puffs.sources])
    x = places.reshape(len(case.DISTANCES), case.ROWS, len(case.ACROSS), 2)
    np.testing.assert_allclose(
        x[:, :, :, 0] - sources[0, 0], np.array(case.DISTANCES)[:, None, None] + 0 * x[..., 0]
    )
    np.testing.assert_allclose(x[..., 1].mean(axis=(0, 2)), sources[:, 1])


WIDTH = 0.2  # m
"""So wide that whiffs end where the centre comes back to, too."""


def plumes(hurst: float, seed: int) -> case.Records:
    """Gaussian plumes whose centres are fractional noise summed up: increments over T grow as T^hurst; forgotten over
    20 s.
    """
    n, rows = 8192, case.ROWS
    rng = np.random.default_rng(seed)
    f = np.fft.rfftfreq(n, case.STEP)
    power = (f**2 + (1.0 / 20.0 / 2.0 / np.pi) ** 2) ** (-hurst - 0.5)
    shape = (len(case.DISTANCES), rows, len(f))
    waves = np.sqrt(power) * (rng.standard_normal(shape) + 1j * rng.standard_normal(shape))
    centre = np.moveaxis(np.fft.irfft(waves, n, axis=-1), -1, 0)
    centre *= 0.16 / centre.std()
    c = np.exp(-0.5 * ((case.ACROSS - centre[..., None]) / WIDTH) ** 2)
    return case.Records(np.arange(n) * case.STEP, {"grid": c})


@pytest.mark.parametrize("hurst", [0.3, 0.5])
def test_exponents_are_those_of_the_returns_of_walks(hurst):
    """Of fractional Brownian motion they are T^-(2 - H) apart (Ding & Yang 1995, doi:10.1103/PhysRevE.52.207)."""
    flows = [plumes(hurst, seed) for seed in range(3)]
    for found in case.durations(flows, "grid", case.LEVEL).values():
        law = case.fitted(found)
        assert law is not None
        assert law.count > 1000
        assert law.value == pytest.approx(2.0 - hurst, abs=0.15)


def test_a_plume_that_rests_on_a_sensor_for_long_or_never_tells_nothing():
    present = np.zeros((100, 3), bool)
    present[:, 1] = True
    present[::3, 2] = True
    assert case.chosen(present).tolist() == [False, False, True]
