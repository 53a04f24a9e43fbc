"""Speed of jax-cfd in a periodic box: ``python jax_box.py N DIM SECONDS`` prints M cell-steps/s.

The script needs an interpreter with jax-cfd, but not this package.
"""

import importlib
import sys
import time

CHUNK = 20  # steps in one call
VISCOSITY = 1e-3


def rate(n: int, dim: int, seconds: float) -> float:
    """Return M cell-steps/s of n**dim cells, 2 pi wide: explicit convection and diffusion, projection by FFT."""
    jax = importlib.import_module("jax")
    base = importlib.import_module("jax_cfd.base")
    grid = base.grids.Grid((n,) * dim, domain=((0.0, 6.283185307179586),) * dim)
    dt = base.equations.stable_time_step(
        max_velocity=1.0, max_courant_number=0.5, viscosity=VISCOSITY, grid=grid
    )
    step = base.equations.semi_implicit_navier_stokes(density=1.0, viscosity=VISCOSITY, dt=dt, grid=grid)
    chunk = jax.jit(base.funcutils.repeated(step, CHUNK))
    u = base.initial_conditions.filtered_velocity_field(
        jax.random.PRNGKey(1), grid, maximum_velocity=1.0, peak_wavenumber=4
    )
    u = jax.block_until_ready(chunk(u))
    done, begin = 0, time.perf_counter()
    while time.perf_counter() - begin < seconds:
        u = jax.block_until_ready(chunk(u))
        done += CHUNK
    return 1e-6 * n**dim * done / (time.perf_counter() - begin)


if __name__ == "__main__":
    print(rate(int(sys.argv[1]), int(sys.argv[2]), float(sys.argv[3])))
