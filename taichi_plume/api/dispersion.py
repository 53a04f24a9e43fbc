"""Steady dispersion on a mean wind: ``tp.dispersion(wind, cell)`` for strengths, likelihoods and gradients."""

from collections.abc import Sequence

import numpy as np

from taichi_plume.agents.dispersion import Dispersion
from taichi_plume.results.run import Run


def dispersion(
    wind: "np.ndarray | Run",
    cell: float | None = None,
    solid: "np.ndarray | None" = None,
    *,
    diffusivity: float = 0.01,
    lifetime: float | None = None,
    depth: float = 1.0,
    open_edges: "bool | Sequence[np.ndarray]" = True,
) -> Dispersion:
    """Return the steady advection-diffusion of a gas on a mean wind, with its adjoint.

    wind: velocity at the centres of the cells, (nx, ny, 2) or (nx, ny, nz, 3) [m/s], made mass-consistent; or a run,
    whose recorded wind is averaged over the time of the robots, on the plane of its slice. cell: edge of the cells [m],
    of a run its own. solid: mask of cells without air. diffusivity: eddy diffusivity [m2/s]. lifetime: time [s] after
    which gas is lost, by default never. depth: of a layer in 2-D [m]. open_edges: whether air may cross the edges, or
    masks of the cells along x-, x+, y-, y+ and so on.

    ``concentration(rates)`` of the result is the gas [kg/m3] of sources with rates [kg/s] in the cells. Its
    ``adjoint(weights)`` is the gradient of weighted concentrations in the rates of sources in all cells, and so the
    response of a sensor, ``adjoint(at(place))``, to a source anywhere. Raises ValueError for other shapes or values.
    """
    if isinstance(wind, Run):
        wind, cell, no_air = _recorded(wind)
        solid = no_air if solid is None else solid
    if cell is None:
        raise ValueError("cell: missing; give the edge of the cells [m]")
    return Dispersion(
        wind, cell, solid, diffusivity=diffusivity, lifetime=lifetime, depth=depth, open_edges=open_edges
    )


def _recorded(run: Run) -> tuple[np.ndarray, float, np.ndarray]:
    """Return the mean recorded wind of a run (nx, ny, 2) [m/s], the edge of its cells [m] and the cells without air."""
    winds = run.winds
    parts = [winds[name].to_numpy() for name in ("u_slice", "v_slice")]  # (times, y, x)
    t, x = (winds[winds["u_slice"].dims[k]].to_numpy() for k in (0, -1))
    mean = np.stack([part[t >= 0.0].mean(axis=0).T for part in parts], axis=-1)
    no_air = np.asarray(~np.isfinite(mean).all(axis=-1))
    return np.where(no_air[..., None], 0.0, mean), float(x[1] - x[0]), no_air
