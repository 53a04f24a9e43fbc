"""Wind and gas of a film at one moment, as functions of the place: linear in time between its frames, and in space.

Beyond the outermost places that a film tells of, the values there hold.
"""

from collections.abc import Callable

import numpy as np

from taichi_plume.files.film import VELOCITIES, Film, dimensions, places

Places = Callable[[np.ndarray], np.ndarray]
"""Values (...), or (..., dim) of a vector, at points (..., dim) [m]."""


def moment(film: Film, names: list[str], t: float | None) -> dict[str, np.ndarray]:
    """Variables at time t [s] of the film, of its last frame unless given; axes (x, y, z). Raises FilmError."""
    last = len(film.times) - 1
    n = last if t is None else int(np.clip(np.searchsorted(film.times, t, side="right") - 1, 0, last))
    frame = film.frame(n, names)
    if t is None or n == last or t <= film.times[n]:
        return frame
    share = (t - film.times[n]) / (film.times[n + 1] - film.times[n])
    later = film.frame(n + 1, names)
    return {name: (1.0 - share) * frame[name] + share * later[name] for name in names}


def velocity(film: Film, t: float | None) -> Places:
    """Of its air [m/s]. Raises FilmError."""
    names: list[str] = list(VELOCITIES[: len(film.shape)])
    parts = [_linear(film, name, values) for name, values in moment(film, names, t).items()]
    return lambda points: np.stack([part(points) for part in parts], axis=-1)


def concentration(film: Film, name: str, t: float | None) -> Places:
    """Of its gas of that name [kg/m³], from the cells that hold air. Raises FilmError."""
    air = (film.still("volume") > 0).astype(float)
    held, share = _linear(film, name, moment(film, [name], t)[name] * air), _linear(film, name, air)
    return lambda points: np.maximum(held(points), 0.0) / np.maximum(share(points), 1e-6)


def _linear(film: Film, name: str, values: np.ndarray) -> Places:
    """Between the places of a variable."""
    from scipy.interpolate import RegularGridInterpolator

    axes = [places(one, film.shape, film.dx) for one in dimensions(name, len(film.shape))[::-1]]
    between = RegularGridInterpolator(axes, np.asarray(values, float))
    low, high = (np.array([axis[end] for axis in axes]) for end in (0, -1))
    return lambda points: between(np.clip(points, low, high))
