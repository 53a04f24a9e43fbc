"""The mixing of synthetic rooms: its arithmetic, and a short run."""

import numpy as np
import pytest

from taichi_plume.validation import room_air_cases
from taichi_plume.validation.case import Curve
from taichi_plume.validation.experiment import Mean
from taichi_plume.validation.room_air_cases import CASES, LOOKS, OF_PARTICLES, RATIO, pseudo_values

pytestmark = pytest.mark.usefixtures("taichi")


def test_modes_of_a_diffusing_ball_tell_its_diffusivity():
    extent, K, airs = (5.0, 4.0, 2.5), 0.003, 6
    k = 2.0 * np.pi / np.array(extent[:2])
    modes = -np.exp(-K * k**2 * np.array(LOOKS)[:, None])
    same = pseudo_values(np.tile(modes, (airs, 1, 1)), extent)
    np.testing.assert_allclose(same, K)
    noisy = modes * (1.0 + 0.1 * np.random.default_rng(1).standard_normal((airs, 2, 2)))
    found = pseudo_values(noisy, extent)
    assert found.std() > 0.0
    assert found.mean() == pytest.approx(K, rel=0.3)


def test_the_default_of_each_room_is_judged_by_the_law_of_closed_rooms():
    (experiment,) = CASES
    judged = {
        one.name: (one.expected[OF_PARTICLES].least, one.expected[OF_PARTICLES].most)
        for one in experiment.conditions
        if OF_PARTICLES in one.expected
    }
    assert judged == {  # by hand
        "the default, 50 m³": (1.17, 2.15),
        "the default, 154 m³": (2.47, 4.54),
        "the default, 7.6 m³": (0.33, 0.61),
    }


@pytest.mark.slow
def test_a_short_run_tells_everything(monkeypatch):
    monkeypatch.setattr(room_air_cases, "ROOM", ((16, 14, 10), 0.2))
    monkeypatch.setattr(room_air_cases, "LOOKS", (5.0, 20.0))
    reported = room_air_cases.released(2)
    means = [part for part in reported.values() if isinstance(part, Mean)]
    assert {mean.n for mean in means} == {2}
    assert reported[RATIO].mean is not None
    (curve,) = (part for part in reported.values() if isinstance(part, Curve))
    width = curve.x[1] - curve.x[0]
    assert curve.computed.sum() * width == pytest.approx(1.0, rel=1e-5)
    assert curve.reference.sum() * width == pytest.approx(1.0, rel=1e-3)
    np.testing.assert_allclose(curve.computed, curve.reference, atol=0.5 * curve.reference.max())
    of = room_air_cases.of_particles(1, (16, 14, 10), 0.2, speed=0.1)
    fast = of[OF_PARTICLES]
    assert isinstance(fast, Mean)
    assert fast.mean is not None
    assert fast.mean > 1.0
