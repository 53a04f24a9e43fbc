"""Picture of a trial seen from above: gas, walls, sources and robots; uses only NumPy."""

from typing import TYPE_CHECKING, Any

import numpy as np

from taichi_plume.scenario import palette
from taichi_plume.scenario.palette import rgb

if TYPE_CHECKING:
    from taichi_plume.agents.swarm import Swarm
    from taichi_plume.envs.bank import Bank
    from taichi_plume.envs.episodes import Episodes

EDGE = 400  # pixels of the longer edge, about
GAS = np.array([200.0, 60.0, 20.0])  # colour of the highest concentration
WALL, SOURCE = np.array(rgb(palette.SOLID), float), np.array(rgb(palette.SOURCE), float)
ROBOT, DONE = np.array(rgb(palette.ROBOTS[0]), float), np.array(rgb(palette.FOUND), float)
"""DONE: has found a source."""
DECADES = 3.0  # range of concentrations with different colours, below the largest of the film


def picture(episodes: "Episodes", e: int) -> np.ndarray:
    """Return environment e as an image (height, width, 3) of uint8, y upwards; mirrored worlds are drawn unmirrored."""
    bank = episodes.bank
    films: Any = episodes.kernel.films  # its fields are opaque to type checkers
    film, gas = int(films.film[e]), int(films.gas_of[e])
    ppm = _gas(bank, film, gas, float(films.begin[e]) + float(films.now[e]))
    top = max(float(np.max(bank.scale[film], initial=0.0)) * 2.0**15, 1e-30)
    strength = np.clip(1.0 + np.log10(np.maximum(ppm / top, 1e-30)) / DECADES, 0.0, 1.0)
    colors = 255.0 + strength[..., None] * (GAS - 255.0)
    air = bank.air[1].reshape(*ppm.shape, -1).any(axis=2)
    colors[~air] = WALL
    n = max(1, round(EDGE / max(ppm.shape)))
    image = np.repeat(np.repeat(colors, n, axis=0), n, axis=1)
    dx = bank.spacing / n
    centers = (np.indices(image.shape[:2]).transpose(1, 2, 0) + 0.5) * dx
    for g, places in enumerate(bank.sources[film]):
        for place in places if gas in (-1, g) else ():
            away = np.abs(centers - place[:2])
            image[(away.min(axis=2) < 1.5 * dx) & (away.max(axis=2) < 6 * dx)] = SOURCE
    swarm = episodes.swarm
    for i in range(e * episodes.robots, (e + 1) * episodes.robots):
        _robot(image, centers, dx, swarm, i)
    return image.transpose(1, 0, 2)[::-1].round().astype(np.uint8)


def _gas(bank: "Bank", film: int, gas: int, t: float) -> np.ndarray:
    """Return ppm (nx, ny) of all gases (gas < 0) or of one gas, at the frame nearest to time t [s] of a film.

    Of a volume, the largest value over the height.
    """
    frame = min(round(t / bank.frame), bank.values.shape[1] - 1)
    ppm = bank.values[film, frame, ..., 2:].astype(np.float32) * bank.scale[film]
    ppm = ppm.sum(axis=-1) if gas < 0 else ppm[..., gas]
    return ppm.reshape(*ppm.shape[:2], -1).max(axis=2)


def _robot(image: np.ndarray, centers: np.ndarray, dx: float, swarm: "Swarm", i: int) -> None:
    """Draw robot i as a disc, at least a few pixels wide, with a line along its heading."""
    x, heading = np.array(swarm.position[i]), float(swarm.heading[i])
    radius = max(float(swarm.radius[i]), 4 * dx)
    away = centers - x
    ahead = away @ [np.cos(heading), np.sin(heading)]
    aside = np.abs(away @ [-np.sin(heading), np.cos(heading)])
    color = DONE if swarm.found[i] else ROBOT
    image[np.hypot(away[..., 0], away[..., 1]) < radius] = color
    image[(aside < dx) & (ahead > 0.0) & (ahead < 2.0 * radius)] = color
