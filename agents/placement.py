"""Start positions of the robots of a group, free of walls, obstacles and other robots of the trial."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from taichi_plume.scenario.robots import Group
from taichi_plume.scenario.starts import GAP, StartArea

DRAWS = 20_000  # random positions tried per trial before an area counts as full
ROUNDING = 1e-9  # m


@dataclass(frozen=True)
class Placed:
    """Robots of a group after placement: positions (n, 2) [m]; radius [m]; trial (n,): trial of each robot."""

    positions: np.ndarray
    radius: float
    trial: np.ndarray


def place(
    group: Group,
    draws: Callable[[int], np.random.Generator],
    distance: Callable[[np.ndarray], np.ndarray],
    occupied: Sequence[Placed] = (),
) -> tuple[np.ndarray, np.ndarray]:
    """Return start positions (trials·count, 2) [m] and headings [rad] of a group, trial after trial.

    draws: function that returns the random generator of a trial. distance: function from points (n, 2) [m] to distances
    (n,) [m] to the next wall or obstacle. occupied: groups placed before. Raises ValueError if robots do not fit.
    """
    start = group.start
    positions = np.empty((group.trials, group.count, 2))
    headings = np.empty((group.trials, group.count))
    for k in range(group.trials):
        rng = draws(group.first_trial + k)
        others = [(o.positions[o.trial == k], o.radius) for o in occupied]
        if start.kind == "area":
            positions[k] = _scatter(group, start, rng, distance, others)
        else:
            positions[k] = _given(group)
            _check(group, positions[k], distance, others)
        headings[k] = rng.uniform(-np.pi, np.pi, group.count)
    if start.heading_deg is not None:
        headings[:] = np.radians(start.heading_deg)
    return positions.reshape(-1, 2), headings.ravel()


def placed(group: Group, positions: np.ndarray) -> Placed:
    """Return the robots of a group placed by `place`, so that later groups avoid them."""
    return Placed(positions, group.body.radius, np.repeat(np.arange(group.trials), group.count))


def _given(group: Group) -> np.ndarray:
    """Return the start positions (count, 2) [m] that the scenario lists. Raises ValueError if their number is wrong."""
    places = group.start.places(group.count)
    if places is None:
        raise ValueError(f"{group.count} robots need as many positions, got {len(group.start.listed)}")
    return places


def _gaps(points: np.ndarray, radius: float, others: list[tuple[np.ndarray, float]]) -> np.ndarray:
    """Return the gap [m] between each disc of this radius at `points` and the nearest of the other discs."""
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
    """Raise ValueError for the first robot at `points` that touches a wall, an obstacle or another robot."""
    radius = group.body.radius
    clearance = distance(points)
    for i, (x, y) in enumerate(points):
        who = f"robot {i} of radius {radius:g} m at ({x:g}, {y:g}) m"
        if clearance[i] < radius + GAP - ROUNDING:
            raise ValueError(f"{who} would touch a wall or an obstacle at the start")
        if _gaps(points[i : i + 1], radius, [*others, (points[:i], radius)])[0] < GAP - ROUNDING:
            raise ValueError(f"{who} would touch another robot at the start")


def _scatter(
    group: Group,
    start: StartArea,
    rng: np.random.Generator,
    distance: Callable[[np.ndarray], np.ndarray],
    others: list[tuple[np.ndarray, float]],
) -> np.ndarray:
    """Return random free start positions (count, 2) [m] in an area. Raises ValueError if the area is too full."""
    radius = group.body.radius
    placed = np.empty((0, 2))
    batch = max(64, 4 * group.count)
    for _ in range(-(-DRAWS // batch)):
        points = rng.uniform(start.low, start.high, (batch, 2))
        free = (distance(points) >= radius + GAP) & (_gaps(points, radius, others) >= GAP)
        for point in points[free]:
            if _gaps(point[None], radius, [(placed, radius)])[0] >= GAP:
                placed = np.vstack([placed, point])
                if len(placed) == group.count:
                    return placed
    raise ValueError(
        f"only {len(placed)} of {group.count} robots of radius {radius:g} m fit into the area; enlarge it"
    )
