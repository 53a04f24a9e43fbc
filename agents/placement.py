"""Where the robots of a group start: none stands in a wall or an obstacle, no two of one trial overlap."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from taichi_plume.agents.contact import SKIN
from taichi_plume.scenario.robots import Group, StartArea, StartAt

DRAWS = 20_000  # random places tried per trial before an area counts as full
ROOM = 2 * SKIN  # m, air around a body at the start
ROUNDING = 1e-9  # m


@dataclass(frozen=True)
class Placed:
    """Robots of one group that stand already: positions (n, 2) [m], their radius [m], their trials (n,)."""

    positions: np.ndarray
    radius: float
    trial: np.ndarray


def place(
    group: Group,
    draws: Callable[[int], np.random.Generator],
    distance: Callable[[np.ndarray], np.ndarray],
    occupied: Sequence[Placed] = (),
) -> tuple[np.ndarray, np.ndarray]:
    """Positions (trials·count, 2) [m] and headings [rad], trial after trial.

    draws: the random numbers of each trial, by its number. distance: of points (n, 2) to the next wall or obstacle,
    (n,) [m]. occupied: the groups before.
    Raises ValueError where robots do not fit.
    """
    start = group.start
    positions = np.empty((group.trials, group.count, 2))
    headings = np.empty((group.trials, group.count))
    for k in range(group.trials):
        rng = draws(group.first_trial + k)
        others = [(o.positions[o.trial == k], o.radius) for o in occupied]
        if isinstance(start, StartArea):
            positions[k] = _scatter(group, start, rng, distance, others)
        else:
            positions[k] = _given(group)
            _check(group, positions[k], distance, others)
        headings[k] = rng.uniform(-np.pi, np.pi, group.count)
    if start.heading_deg is not None:
        headings[:] = np.radians(start.heading_deg)
    return positions.reshape(-1, 2), headings.ravel()


def placed(group: Group, positions: np.ndarray) -> Placed:
    """The robots of a group that `place` has put down, for the groups to come."""
    return Placed(positions, group.body.radius, np.repeat(np.arange(group.trials), group.count))


def _given(group: Group) -> np.ndarray:
    """The places, (count, 2), that the scenario gives."""
    start = group.start
    if isinstance(start, StartAt):
        if len(start.positions) != group.count:
            raise ValueError(f"{group.count} robots need as many positions, got {len(start.positions)}")
        return np.array(start.positions)
    assert not isinstance(start, StartArea)
    return np.linspace(start.begin, start.end, group.count)


def _gaps(points: np.ndarray, radius: float, others: list[tuple[np.ndarray, float]]) -> np.ndarray:
    """Air [m] between discs at `points` and the nearest of the other discs."""
    gaps = np.full(len(points), np.inf)
    for positions, other_radius in others:
        if len(positions):
            apart = np.linalg.norm(points[:, None] - positions[None], axis=-1).min(axis=1)
            gaps = np.minimum(gaps, apart - radius - other_radius)
    return gaps


def _check(
    group: Group,
    points: np.ndarray,
    distance: Callable[[np.ndarray], np.ndarray],
    others: list[tuple[np.ndarray, float]],
) -> None:
    """Raise ValueError for the first robot that touches a wall, an obstacle or another robot."""
    radius = group.body.radius
    clearance = distance(points)
    for i, (x, y) in enumerate(points):
        who = f"robot {i} of radius {radius:g} m at ({x:g}, {y:g}) m"
        if clearance[i] < radius + ROOM - ROUNDING:
            raise ValueError(f"{who} would touch a wall or an obstacle at the start")
        if _gaps(points[i : i + 1], radius, [*others, (points[:i], radius)])[0] < ROOM - ROUNDING:
            raise ValueError(f"{who} would touch another robot at the start")


def _scatter(
    group: Group,
    start: StartArea,
    rng: np.random.Generator,
    distance: Callable[[np.ndarray], np.ndarray],
    others: list[tuple[np.ndarray, float]],
) -> np.ndarray:
    """Random free places, (count, 2): drawn one by one, kept where nothing is touched."""
    radius = group.body.radius
    kept = np.empty((0, 2))
    batch = max(64, 4 * group.count)
    for _ in range(-(-DRAWS // batch)):
        points = rng.uniform(start.low, start.high, (batch, 2))
        free = (distance(points) >= radius + ROOM) & (_gaps(points, radius, others) >= ROOM)
        for point in points[free]:
            if _gaps(point[None], radius, [(kept, radius)])[0] >= ROOM:
                kept = np.vstack([kept, point])
                if len(kept) == group.count:
                    return kept
    raise ValueError(
        f"only {len(kept)} of {group.count} robots of radius {radius:g} m fit into the area; enlarge it"
    )
