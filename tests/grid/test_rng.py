import numpy as np
import pytest

from taichi_plume.engine import ti
from taichi_plume.grid.rng import generator, normal4, philox, uniform4

pytestmark = pytest.mark.usefixtures("taichi")

N = 1 << 14


def drawn(function, dtype, seed=1, stream=2, tick=3):
    out = ti.vector_field(4, dtype, N)

    @ti.kernel
    def draw(a: ti.u32, b: ti.u32, t: ti.i32):
        for i in range(N):
            out[i] = function(a, b, i, t, 0)

    draw(seed, stream, tick)
    return out.to_numpy()


def test_philox_matches_its_published_vectors():
    """Known answers of Philox4x32-10 for counters and keys of zeros, as its authors publish them."""
    words = ti.vector_field(4, ti.u32, ())

    @ti.kernel
    def zeros():
        words[None] = philox(ti.u32(0), ti.u32(0), 0, 0, 0)

    zeros()
    assert words[None].tolist() == [0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8]


def test_uniform_and_normal_numbers_have_their_moments():
    u = drawn(uniform4, ti.f32)
    assert abs(u.mean() - 0.5) < 0.005
    assert abs(u.var() - 1 / 12) < 0.002
    assert u.min() > 0.0
    assert u.max() < 1.0
    z = drawn(normal4, ti.f32)
    assert abs(z.mean()) < 0.01
    assert abs(z.std() - 1.0) < 0.01
    assert abs((z**4).mean() - 3.0) < 0.2
    assert np.abs(np.corrcoef(z.T) - np.eye(4)).max() < 0.03


def test_numbers_depend_on_seed_stream_and_tick_only():
    base = drawn(uniform4, ti.f32)
    np.testing.assert_array_equal(base, drawn(uniform4, ti.f32))
    for changed in ({"seed": 9}, {"stream": 9}, {"tick": 9}):
        assert np.mean(base == drawn(uniform4, ti.f32, **changed)) < 0.001


def test_host_streams_are_named():
    a = generator(1, "a").standard_normal(4)
    np.testing.assert_array_equal(a, generator(1, "a").standard_normal(4))
    assert not np.array_equal(a, generator(1, "b").standard_normal(4))
    assert not np.array_equal(a, generator(2, "a").standard_normal(4))
