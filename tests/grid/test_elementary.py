import numpy as np
import pytest

from taichi_plume.engine import ti
from taichi_plume.grid.elementary import cos_sin, direction, exp, log

pytestmark = pytest.mark.usefixtures("taichi")

N = 1 << 14


def test_elementary_functions_are_those_of_numpy():
    """Errors are rounding errors of f32, of the argument if it is large, else of the result."""
    rng = np.random.default_rng(1)
    points = rng.uniform(-12.0, 12.0, (N, 2)).astype(np.float32)
    points[:5] = [[0.0, 0.0], [0.0, 1.0], [0.0, -1.0], [1.0, 0.0], [-1.0, 0.0]]
    ratios = np.exp(rng.uniform(-80.0, 80.0, N)).astype(np.float32)
    x = ti.vector_field(2, ti.f32, N)
    ratio = ti.field(ti.f32, N)
    out = ti.vector_field(5, ti.f32, N)
    x.from_numpy(points)
    ratio.from_numpy(ratios)

    @ti.kernel
    def work():
        for n in range(N):
            e = cos_sin(x[n][0])
            out[n] = ti.Vector([e[0], e[1], direction(x[n][1], x[n][0]), exp(x[n][0]), log(ratio[n])])

    work()
    a, b = points.T.astype(float)
    cosine, sine, angle, power, logarithm = out.to_numpy().T
    np.testing.assert_allclose(cosine, np.cos(a), atol=1e-6)
    np.testing.assert_allclose(sine, np.sin(a), atol=1e-6)
    np.testing.assert_allclose(angle, np.arctan2(b, a), atol=6e-7)
    np.testing.assert_allclose(power, np.exp(a), rtol=2e-6)
    np.testing.assert_allclose(logarithm, np.log(ratios.astype(float)), rtol=2e-7, atol=2e-7)
