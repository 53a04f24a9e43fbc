from math import pi

import numpy as np
import pytest
import taichi as ti

from taichi_plume.grid.transfer import reader, uploader
from taichi_plume.solvers.convection import LIMITED

pytestmark = pytest.mark.usefixtures("taichi")

CELLS = 40


@pytest.fixture(scope="module")
def reconstructed(taichi):
    """Values on the lower faces of up to CELLS periodic cells with these averages, as air of v goes by."""
    q, out = ti.field(ti.f32, CELLS + 6), {scheme: ti.field(ti.f32, CELLS + 6) for scheme in LIMITED}
    put, read = uploader(q), reader(*out.values())

    @ti.kernel
    def at_faces(v: float):
        for i in range(3, CELLS + 3):
            for scheme in ti.static(tuple(LIMITED)):
                out[scheme][i] = LIMITED[scheme].value(q, ti.Vector([i]), ti.Vector([1]), v)

    def values(scheme: str, averages: np.ndarray, v: float) -> np.ndarray:
        n = len(averages)
        put(averages[(np.arange(CELLS + 6) - 3) % n])
        at_faces(v)
        return read()[list(LIMITED).index(scheme)][3 : 3 + n].astype(float)

    return values


@pytest.mark.parametrize("v", [1.0, -1.0])
def test_smooth_profiles_keep_fifth_order_at_their_tops_too(reconstructed, v):
    errors = []
    for n in (12, 24):
        edges = np.linspace(0.0, 2 * pi, n + 1)
        averages = 2.0 + np.diff(np.sin(edges)) / np.diff(edges)  # of 2 + cos x
        errors.append(np.abs(reconstructed("weno5", averages, v) - 2.0 - np.cos(edges[:-1])).max())
    assert errors[1] > 1e-6  # more than rounding
    assert np.log2(errors[0] / errors[1]) >= 4.5


@pytest.mark.parametrize("scale", [1.0, 1e-9, 1e6])
@pytest.mark.parametrize("v", [1.0, -1.0])
@pytest.mark.parametrize("scheme", LIMITED)
def test_a_step_makes_no_wiggles_whatever_the_unit(reconstructed, scheme, scale, v):
    value = reconstructed(scheme, scale * np.where(np.arange(40) < 20, 1.0, 2.0), v)
    assert value.min() >= (1.0 - 1e-6) * scale
    assert value.max() <= (2.0 + 1e-6) * scale


@pytest.mark.parametrize("scheme", LIMITED)
def test_a_uniform_field_stays_to_the_bit(reconstructed, scheme):
    assert np.all(reconstructed(scheme, np.full(16, 0.3), 1.0) == np.float32(0.3))


@pytest.mark.parametrize("v", [1.0, -1.0])
@pytest.mark.parametrize("scheme", LIMITED)
def test_no_cell_is_asked_for_more_than_the_steps_allow(reconstructed, scheme, v):
    averages = np.random.default_rng(1).lognormal(sigma=3.0, size=40)
    upwind = np.roll(averages, 1) if v > 0 else averages
    value = reconstructed(scheme, averages, v)
    assert np.all(value >= 0.0)
    assert np.all(value <= LIMITED[scheme].steepest * upwind * (1.0 + 1e-6))
