"""Bodies never overlap walls, obstacles or each other: more than a million random robot-steps in random scenes.

The distances are worked out anew here, in float64, from the obstacles of the scenario. Walkers are left out: one may
walk into a robot.
"""

import struct
from pathlib import Path

import numpy as np
import pytest
from robots import NOWHERE, group

from taichi_plume.agents.collisions import SKIN
from taichi_plume.agents.placement import Placed, place, placed
from taichi_plume.agents.swarm import Swarm
from taichi_plume.grid.clearance import ClearanceMap
from taichi_plume.scenario.domain import Domain
from taichi_plume.scenario.obstacles import Box, Cylinder, Mesh, Prism, Sphere
from taichi_plume.scenario.shapes import shape

pytestmark = pytest.mark.usefixtures("taichi")

# What is met is approached to SKIN, others are passed at half of it; the rest is for rounding (4 um at 60 m)
AIR = 0.4 * SKIN
BODY_HEIGHT = 0.2  # m, of the highest body
TRIALS = 120
TICKS = 120


def to_polygon(p, corners):
    """Distance of points (n, 2) to a convex polygon that turns left, 0 inside."""
    nearest = np.full(len(p), np.inf)
    inside = np.ones(len(p), bool)
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        way, apart = b - a, p - a
        share = np.clip((apart @ way) / (way @ way), 0, 1)
        nearest = np.minimum(nearest, np.hypot(*(apart - share[:, None] * way).T))
        inside &= way[0] * apart[:, 1] - way[1] * apart[:, 0] > 0
    return np.where(inside, 0.0, nearest)


def corners_of(one, dim):
    """Of the footprint of a box, prism or mesh, counterclockwise; None where it is above all bodies."""
    if isinstance(one, Box):
        if dim == 3 and one.center[2] - one.size[2] / 2 >= BODY_HEIGHT:
            return None
        yaw = np.radians(one.yaw_deg)
        turn = np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]])
        half = np.array(one.size[:2]) / 2
        return np.array(one.center[:2]) + (half * [[-1, -1], [1, -1], [1, 1], [-1, 1]]) @ turn
    if isinstance(one, Prism):
        return np.array(one.vertices) if dim == 2 or one.base < BODY_HEIGHT else None
    yaw = np.radians(one.yaw_deg)
    turn = np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]])
    return one.scale * WEDGE @ turn + one.translate[:2]


def distance_to(one, p, dim):
    """Distance [m] of upright bodies' axes at (n, 2) to an obstacle, 0 inside."""
    if isinstance(one, Cylinder):
        gap = np.hypot(*(p - one.center).T) - one.radius
        return gap if dim == 2 or one.base < BODY_HEIGHT else np.full(len(p), np.inf)
    if isinstance(one, Sphere):
        above = max(one.center[2] - BODY_HEIGHT, 0.0) if dim == 3 else 0.0
        if above >= one.radius:
            return np.full(len(p), np.inf)
        return np.hypot(*(p - one.center[:2]).T) - np.sqrt(one.radius**2 - above**2)
    corners = corners_of(one, dim)
    return np.full(len(p), np.inf) if corners is None else to_polygon(p, corners)


def air_to_surroundings(p, radius, obstacles, extent):
    """Air [m] between bodies (n, 2) and the walls or obstacles next to them."""
    distance = np.minimum(p, np.array(extent[:2]) - p).min(axis=1)
    for one in obstacles:
        distance = np.minimum(distance, distance_to(one, p, len(extent)))
    return distance - radius


def air_between(p, radius, groups):
    """Air [m] between the bodies of each trial, over all pairs."""
    gaps = []
    start = np.cumsum([0] + [g.count * g.trials for g in groups])
    for n, a in enumerate(groups):
        for m, b in enumerate(groups[: n + 1]):
            trials = min(a.trials, b.trials)
            q = p[start[n] :][: trials * a.count].reshape(trials, a.count, 1, 2)
            s = p[start[m] :][: trials * b.count].reshape(trials, 1, b.count, 2)
            gap = np.hypot(*np.moveaxis(q - s, -1, 0)) - a.body.radius - b.body.radius
            gaps.append(gap[:, *np.tril_indices(a.count, -1)] if n == m else gap)
    return np.concatenate([gap.ravel() for gap in gaps])


# ---------------------------------------------------------------- random scenes

WEDGE = np.array([[0.0, 0.0], [0.5, 0.1], [0.1, 0.4]])  # m, the footprint of the mesh


def write_wedge(path):
    """The wedge, 0.3 m high, as an STL file."""
    low, high = np.insert(WEDGE, 2, 0.0, axis=1), np.insert(WEDGE, 2, 0.3, axis=1)
    faces = [low[::-1], high]
    for n in range(3):
        m = (n + 1) % 3
        faces += [[low[n], low[m], high[m]], [low[n], high[m], high[n]]]
    body = b"".join(struct.pack("<12fH", 0, 0, 0, *np.ravel(face), 0) for face in faces)
    path.write_bytes(bytes(80) + struct.pack("<I", len(faces)) + body)


def random_obstacles(rng, low, high, dim):
    """Boxes in any direction, some of them plates, pillars, balls and prisms; some overlap, some hang above."""

    def at(*sizes):
        return (*rng.uniform(low, high), *sizes)

    obstacles = []
    for _ in range(3):
        size = (rng.choice([0.002, 0.1, 0.4]), rng.uniform(0.1, 0.7))
        z = (rng.uniform(0.1, 0.4),) if dim == 3 else ()
        upright = (rng.uniform(0.1, 0.3),) if dim == 3 else ()
        box = {"center": at(*z), "size": (*size, *upright), "yaw_deg": rng.uniform(-180, 180)}
        obstacles.append(Box.model_validate({"kind": "box", **box}))
    obstacles.append(Cylinder(kind="cylinder", center=at(), radius=rng.uniform(0.01, 0.3)))
    floating = Cylinder(kind="cylinder", center=at(), radius=0.1, base=rng.uniform(0.1, 0.3))
    obstacles += [floating] if dim == 3 else []
    z = (rng.uniform(0.0, 0.5),) if dim == 3 else ()
    obstacles.append(Sphere(kind="sphere", center=at(*z), radius=rng.uniform(0.05, 0.3)))
    angles = np.sort(rng.uniform(0, 2 * np.pi, 5))  # a convex pentagon
    rim = np.array(at()) + rng.uniform(0.1, 0.4) * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    obstacles.append(Prism(kind="prism", vertices=tuple(map(tuple, rim))))
    return obstacles


def team(name, count, trials, low, high, **body):
    start = {"kind": "area", "low": low, "high": high}
    return group(name=name, count=count, trials=trials, start=start, body={"height": BODY_HEIGHT, **body})


def crowd(groups, distance, seed):
    """Free places and headings for all groups."""
    occupied: list[Placed] = []
    headings = []
    for n, one in enumerate(groups):
        positions, heading = place(
            one, lambda k, n=n: np.random.default_rng([seed, n, k]), distance, occupied
        )
        occupied.append(placed(one, positions))
        headings.append(heading)
    return np.concatenate([one.positions for one in occupied]), np.concatenate(headings)


def scene(rng, groups, extent, low, high, folder, mesh):
    """Obstacles among which there is room for the groups, the clearance from them, places and headings."""
    domain = Domain(size=extent, spacing=0.1)
    while True:
        obstacles = random_obstacles(rng, low, high, len(extent))
        if mesh:
            where = (*rng.uniform(low, high), 0.0)
            turn = rng.uniform(-180, 180)
            obstacles.append(Mesh(kind="mesh", file="wedge.stl", yaw_deg=turn, translate=where, section=0.1))
        shapes = [shape(one, domain, folder) for one in obstacles]
        clearance = ClearanceMap(shapes, extent, BODY_HEIGHT)
        try:
            return obstacles, clearance, *crowd(groups, clearance.distance_at, int(rng.integers(2**31)))
        except ValueError:  # too little room
            continue


@pytest.mark.parametrize(
    ("extent", "low", "mesh"),
    [
        ((2.4, 2.0), (0.0, 0.0), False),
        pytest.param((2.6, 2.2, 0.6), (0.0, 0.0), True, marks=pytest.mark.slow),
        # in a far corner, where rounding and the clearance map are coarse
        pytest.param((60.0, 40.0), (57.0, 37.0), False, marks=pytest.mark.slow),
    ],
    ids=["2-D", "3-D", "large"],
)
@pytest.mark.slow
def test_no_body_ever_overlaps_anything(extent: tuple[float, ...], low, mesh, tmp_path: Path):
    """Robots of four kinds in 120 trials drive blindly through random scenes."""
    rng = np.random.default_rng(1)
    high = extent[:2]
    write_wedge(tmp_path / "wedge.stl")
    groups = (
        team("small", 5, TRIALS, low, high, radius=0.06, max_speed=0.6, max_turn_rate_deg=360),
        team("large", 1, TRIALS, low, high, radius=0.17, max_speed=1.0, wheel_base=0.24),
        team("fast", 2, TRIALS // 2, low, high, radius=0.08, max_speed=5.0, max_turn_rate_deg=2000),
        team("heavy", 2, TRIALS // 3, low, high, radius=0.1, max_speed=1.5, max_acceleration=1.0),
    )
    swarm, steps, at_surfaces, together = None, 0, 0, 0
    for dt in (0.02, 0.1, 0.5, 0.1):
        obstacles, clearance, positions, headings = scene(rng, groups, extent, low, high, tmp_path, mesh)
        if swarm is None:
            swarm = Swarm(groups, positions, headings, clearance, NOWHERE, 0)
            radius = swarm.radius.to_numpy().astype(float)
            command = np.zeros((2, swarm.count), np.float32)
        swarm.clearance.values.from_numpy(clearance.values.to_numpy())
        swarm.position.from_numpy(positions.astype(np.float32))
        swarm.heading.from_numpy(headings.astype(np.float32))
        path, p = swarm.path_length.to_numpy(), swarm.position.to_numpy().astype(float)
        for tick in range(1, TICKS + 1):
            new = rng.random(swarm.count) < 0.15
            command[0, new] = rng.uniform(-1.2, 1.2, new.sum()) * swarm.max_speed.to_numpy()[new]
            command[1, new] = rng.normal(0.0, 2.0, new.sum())
            swarm.speed_command.from_numpy(command[0])
            swarm.turn_rate_command.from_numpy(command[1])
            swarm.move(tick, tick * dt, dt)
            before, path_before = p, path
            p, path = swarm.position.to_numpy().astype(float), swarm.path_length.to_numpy()
            air = air_to_surroundings(p, radius, obstacles, extent)
            gaps = air_between(p, radius, groups)
            assert air.min() > AIR
            assert gaps.min() > AIR
            # who went straight did not jump over anything either
            straight = path - path_before < np.hypot(*(p - before).T) + 1e-5
            for share in (0.35, 0.7):
                between = (before + share * (p - before))[straight]
                assert air_to_surroundings(between, radius[straight], obstacles, extent).min() > AIR - 1e-5
            at_surfaces += (swarm.blocked.to_numpy() == 1).sum()
            together += (gaps < 2 * SKIN).sum()
            steps += swarm.count
    assert steps >= 400_000
    assert at_surfaces > 20_000
    assert together > 2_000
