"""No body ever overlaps anything, moves are those of a unicycle, trials are independent."""

import numpy as np
import pytest
import taichi as ti

from taichi_plume.agents.contact import SKIN
from taichi_plume.agents.placement import Placed, place, placed
from taichi_plume.agents.swarm import Swarm
from taichi_plume.scenario.algorithms import Casting
from taichi_plume.scenario.obstacles import Cylinder
from taichi_plume.scenario.robots import Body, Group, StartArea, StartAt, StartLine

EXTENT = (4.0, 3.0)
NOWHERE = np.empty((0, 2))


@ti.data_oriented
class Arena:
    """Walls around EXTENT, a round obstacle and a thin upright plate, in closed form; they can be moved."""

    def __init__(self):
        self.disc = ti.field(ti.f32, 3)  # x, y, radius
        self.plate = ti.field(ti.f32, 4)  # x, y, half width, half length

    def set(self, disc, plate):
        self.disc.from_numpy(np.array(disc, np.float32))
        self.plate.from_numpy(np.array(plate, np.float32))

    @ti.func
    def nearest(self, p):
        """Distance and normal of the next surface; the normal is meant for the outside of plate and disc."""
        best = ti.Vector([p[0], 1.0, 0.0])
        if p[1] < best[0]:
            best = ti.Vector([p[1], 0.0, 1.0])
        for d in ti.static(range(2)):
            if EXTENT[d] - p[d] < best[0]:
                best = ti.Vector([EXTENT[d] - p[d], float(d - 1), float(-d)])
        apart = p - ti.Vector([self.disc[0], self.disc[1]])
        if apart.norm() - self.disc[2] < best[0]:
            best = ti.Vector([apart.norm() - self.disc[2], apart[0] / apart.norm(), apart[1] / apart.norm()])
        center, half = ti.Vector([self.plate[0], self.plate[1]]), ti.Vector([self.plate[2], self.plate[3]])
        apart = p - ti.math.clamp(p, center - half, center + half)
        if apart.norm() < best[0]:
            best = ti.Vector([apart.norm(), apart[0] / apart.norm(), apart[1] / apart.norm()])
        return best

    @ti.func
    def distance(self, p):
        return self.nearest(p)[0]

    @ti.func
    def normal(self, p):
        best = self.nearest(p)
        return ti.Vector([best[1], best[2]])

    def distance_at(self, points):
        """The same distance in float64."""
        points = np.asarray(points, float)
        disc, plate = self.disc.to_numpy().astype(float), self.plate.to_numpy().astype(float)
        walls = np.minimum(points, np.array(EXTENT) - points).min(-1)
        round_ = np.hypot(*(points - disc[:2]).T) - disc[2]
        low, high = plate[:2] - plate[2:], plate[:2] + plate[2:]
        nearest = np.clip(points, low, high)
        return np.minimum(np.minimum(walls, round_), np.hypot(*(points - nearest).T))


def team(count, trials=1, name="team", radius=0.08, reach=0.0, speed=1.0, turn=360.0, start=None):
    return Group(
        name=name,
        count=count,
        trials=trials,
        start=start or StartArea(kind="area", low=(0, 0), high=EXTENT),
        algorithm=Casting(kind="casting"),
        body=Body(radius=radius, max_speed=speed, max_turn_rate_deg=turn),
        reach=reach,
    )


def empty_arena():
    arena = Arena()
    arena.set([-9, -9, 0.1], [-9, -9, 0.1, 0.1])
    return arena


def swarm_at(positions, headings, arena=None, groups=None, sources=NOWHERE, **body):
    groups = groups or (team(len(positions), **body),)
    return Swarm(groups, np.array(positions), np.array(headings), arena or empty_arena(), sources, 0)


def command(swarm, speed, turn_rate):
    n = swarm.count
    swarm.speed_command.from_numpy(np.broadcast_to(np.float32(speed), n).copy())
    swarm.turn_rate_command.from_numpy(np.broadcast_to(np.float32(turn_rate), n).copy())


def overlap(swarm, arena):
    """The deepest overlap [m] of any body with anything, from float64 distances; negative: all are free."""
    p = swarm.position.to_numpy().astype(float)
    r = swarm.radius.to_numpy().astype(float)
    worst = (r - arena.distance_at(p)).max()
    for k in range(swarm.trials):
        teams = [g.start + k * g.count + np.arange(g.count) for g in swarm.groups if k < g.trials]
        of_trial = np.concatenate(teams)
        q, s = p[of_trial], r[of_trial]
        apart = np.hypot(*(q[:, None] - q[None]).T)
        np.fill_diagonal(apart, np.inf)
        worst = max(worst, (s[:, None] + s[None] - apart).max())
    return worst


def test_nothing_ever_overlaps():
    """Two groups in 40 trials drive blindly through four scenes, 0.3 m a tick at most; a plate is thin."""
    rng = np.random.default_rng(1)
    arena = Arena()
    groups = (team(6, 40, "small", radius=0.08, speed=0.6), team(3, 25, "large", radius=0.2, speed=3.0))
    swarm = None
    for _ in range(4):
        arena.set(
            [rng.uniform(1, 3), rng.uniform(1, 2), rng.uniform(0.02, 0.4)],
            [rng.uniform(1, 3), rng.uniform(0.8, 2.2), 0.005, rng.uniform(0.1, 0.6)],
        )
        occupied: list[Placed] = []
        headings = []
        for group in groups:
            positions, heading = place(group, np.random.default_rng, arena.distance_at, occupied)
            occupied.append(placed(group, positions))
            headings.append(heading)
        positions, heading = np.concatenate([o.positions for o in occupied]), np.concatenate(headings)
        if swarm is None:
            swarm = Swarm(groups, positions, heading, arena, NOWHERE, 0)
        swarm.position.from_numpy(positions.astype(np.float32))
        swarm.heading.from_numpy(heading.astype(np.float32))
        swarm.path_length.fill(0)
        assert overlap(swarm, arena) < 0
        bumps = 0
        for tick in range(1, 81):
            if tick % 8 == 1:
                command(swarm, rng.uniform(-0.5, 4, swarm.count), rng.normal(0, 1, swarm.count))
            before = swarm.position.to_numpy()
            swarm.move(tick, 0.1 * tick, 0.1)
            assert overlap(swarm, arena) < -0.4 * SKIN  # air is left for the rounding
            jump = np.hypot(*(swarm.position.to_numpy() - before).T)
            assert (jump <= swarm.max_speed.to_numpy() * 0.1 + 1e-5).all()
            bumps += swarm.blocked.to_numpy().sum()
        assert bumps > 100
        assert np.median(swarm.path_length.to_numpy()) > 1.0


@pytest.mark.parametrize("speed", [0.3, 30.0])
def test_nobody_passes_through_a_thin_plate_or_another_robot(speed):
    arena = Arena()
    arena.set([-9, -9, 0.1], [2.0, 1.5, 0.001, 1.4])
    swarm = swarm_at([[1.0, 2.0], [1.0, 1.0], [1.6, 1.0]], [0, 0, np.pi / 2], arena, speed=100.0)
    for tick in range(1, 200):
        command(swarm, [speed, speed, 0], 0)
        swarm.move(tick, tick * 0.1, 0.1)
    x = swarm.position.to_numpy()[:, 0]
    assert x[0] == pytest.approx(2.0 - 0.001 - 0.08, abs=0.003)
    assert x[1] == pytest.approx(1.6 - 0.16, abs=0.003)
    assert x[2] == pytest.approx(1.6)
    assert swarm.blocked.to_numpy().tolist() == [1, 1, 0]


def test_a_free_robot_drives_a_circle():
    """Commands v, w make a circle of radius v/w; after a full turn the robot is back, 2π v/w further."""
    v, w, n = 0.2, 1.0, 90
    dt = 2 * np.pi / (w * n)
    swarm = swarm_at([[2.0, 1.5]], [0.0])
    furthest = 0.0
    for tick in range(1, n + 1):
        command(swarm, v, w)
        swarm.move(tick, tick * dt, dt)
        center = np.array([2.0, 1.5 + v / w])
        furthest = max(furthest, abs(np.hypot(*(swarm.position.to_numpy()[0] - center)) - v / w))
    assert furthest < 1e-5
    assert swarm.position.to_numpy()[0] == pytest.approx([2.0, 1.5], abs=1e-5)
    assert swarm.heading.to_numpy()[0] == pytest.approx(0, abs=1e-4)
    perimeter = 2 * v / w * n * np.sin(np.pi / n)  # of the polygon through the n points
    assert swarm.path_length.to_numpy()[0] == pytest.approx(perimeter, rel=1e-5)


def test_commands_are_clipped_to_the_body():
    swarm = swarm_at([[2.0, 1.5], [1.0, 1.5]], [0.0, 0.0], speed=0.2, turn=90.0)
    command(swarm, [9.0, 0.0], [0.0, -50.0])
    swarm.move(1, 0.1, 0.1)
    assert swarm.position.to_numpy()[0] == pytest.approx([2.02, 1.5], abs=1e-6)
    assert swarm.heading.to_numpy()[1] == pytest.approx(-np.pi / 2 * 0.1)


def test_a_robot_slides_along_a_wall():
    """Pressed on the wall at 45° it goes on with the tangential part of its speed, and feels the wall."""
    swarm = swarm_at([[1.0, 0.2]], [-np.pi / 4], speed=0.5)
    for tick in range(1, 51):
        command(swarm, 0.5, 0.0)
        swarm.move(tick, tick * 0.1, 0.1)
    x, y = swarm.position.to_numpy()[0]
    assert y == pytest.approx(0.08, abs=0.003)
    assert x == pytest.approx(1.0 + 2.5 * np.cos(np.pi / 4), abs=0.06)
    assert swarm.blocked.to_numpy()[0] == 1


def test_driving_along_a_wall_is_no_contact():
    swarm = swarm_at([[1.0, 0.0812]], [-0.02], speed=0.5)
    for tick in range(1, 21):
        command(swarm, 0.5, 0.0)
        swarm.move(tick, tick * 0.1, 0.1)
        assert swarm.blocked.to_numpy()[0] == 0
    assert swarm.position.to_numpy()[0, 0] == pytest.approx(2.0, abs=0.02)


def test_a_robot_rounds_an_obstacle_it_meets_off_centre():
    arena = Arena()
    arena.set([2.0, 1.5, 0.3], [-9, -9, 0.1, 0.1])
    swarm = swarm_at([[1.0, 1.55]], [0.0], arena, speed=0.5)
    for tick in range(1, 101):
        command(swarm, 0.5, 0.0)
        swarm.move(tick, tick * 0.1, 0.1)
    assert swarm.position.to_numpy()[0, 0] > 3.5


def test_trials_do_not_interact():
    """Trial 1 of three, alone in a swarm, drives the very same way: the others neither see nor touch it."""
    rng = np.random.default_rng(2)
    arena = empty_arena()
    group = team(8, 3)
    positions, headings = place(group, np.random.default_rng, arena.distance_at)
    speeds, turns = rng.uniform(0, 1, (60, 24)), rng.normal(0, 2, (60, 24))
    together = swarm_at(positions, headings, arena, (group,))
    alone = swarm_at(positions[8:16], headings[8:16], arena, (team(8),))
    bumps = 0
    for tick in range(60):
        command(together, speeds[tick], turns[tick])
        command(alone, speeds[tick, 8:16], turns[tick, 8:16])
        together.move(tick, tick * 0.1, 0.1)
        alone.move(tick, tick * 0.1, 0.1)
        bumps += alone.blocked.to_numpy().sum()
    assert bumps > 0
    assert (together.position.to_numpy()[8:16] == alone.position.to_numpy()).all()


def test_who_reaches_a_source_stops_there():
    sources = np.array([[3.0, 1.5], [0.5, 0.5]])
    swarm = swarm_at([[2.0, 1.5], [2.0, 2.5]], [0.0, 0.0], sources=sources, reach=0.36, speed=0.5)
    for tick in range(1, 40):
        command(swarm, [0.5, 0.2], 0.0)
        swarm.move(tick, tick * 0.1, 0.1)
    snapshot = swarm.snapshot()
    assert snapshot["found"].tolist() == [1, 0]
    assert not swarm.all_found()
    # 0.64 m at 0.05 m a tick: reached with tick 13
    assert snapshot["found_time"][0] == pytest.approx(1.3)
    assert np.isnan(snapshot["found_time"][1])
    assert snapshot["position"][0] == pytest.approx([2.65, 1.5], abs=1e-5)
    assert snapshot["path_length"][0] == pytest.approx(0.65, abs=1e-5)


def test_an_empty_swarm_is_fine():
    swarm = Swarm((), NOWHERE, np.empty(0), empty_arena(), NOWHERE, 0)
    swarm.move(1, 0.1, 0.1)
    assert swarm.count == 0
    assert swarm.snapshot()["position"].shape == (0, 2)


def test_places_of_each_kind():
    distance = empty_arena().distance_at
    line = StartLine(kind="line", begin=(1, 1), end=(1, 2), heading_deg=90)
    positions, headings = place(team(3, 2, start=line), np.random.default_rng, distance)
    assert positions == pytest.approx(np.array([[1, 1], [1, 1.5], [1, 2]] * 2))
    assert headings == pytest.approx(np.pi / 2)

    given = StartAt(kind="positions", positions=((1, 1), (2, 2)))
    positions, headings = place(team(2, 2, start=given), np.random.default_rng, distance)
    assert positions == pytest.approx(np.array([[1, 1], [2, 2]] * 2))
    assert len(np.unique(headings)) == 4

    area = StartArea(kind="area", low=(1, 1), high=(2, 2))
    first = team(5, 3, start=area)
    earlier = placed(first, place(first, np.random.default_rng, distance)[0])
    positions, _ = place(team(5, 4, radius=0.1, start=area), np.random.default_rng, distance, [earlier])
    for k in range(4):
        own, others = positions[5 * k : 5 * k + 5], earlier.positions[earlier.trial == k]
        assert ((own >= 1) & (own <= 2)).all()
        apart = np.hypot(*(own[:, None] - own[None]).T)
        assert apart[~np.eye(5, dtype=bool)].min() > 0.2
        if len(others):
            assert np.hypot(*(own[:, None] - others[None]).T).min() > 0.18


@pytest.mark.parametrize(
    ("start", "count", "message"),
    [
        (StartAt(kind="positions", positions=((1, 1),)), 2, "2 robots need as many positions, got 1"),
        (StartAt(kind="positions", positions=((1, 0.05),)), 1, "would touch a wall or an obstacle"),
        (StartAt(kind="positions", positions=((1, 1), (1.1, 1))), 2, r"robot 1 .* would touch another robot"),
        (StartArea(kind="area", low=(1, 1), high=(1.2, 1.2)), 9, "only [1-4] of 9 robots of radius"),
    ],
)
def test_places_that_do_not_work(start, count, message):
    with pytest.raises(ValueError, match=message):
        place(team(count, start=start), np.random.default_rng, empty_arena().distance_at)


def test_later_groups_keep_clear_of_earlier_ones():
    at = StartAt(kind="positions", positions=((1, 1),))
    distance = empty_arena().distance_at
    first = team(1, start=at)
    earlier = placed(first, place(first, np.random.default_rng, distance)[0])
    with pytest.raises(ValueError, match="would touch another robot"):
        place(team(1, name="second", start=at), np.random.default_rng, distance, [earlier])


def test_robots_stop_at_what_walks_about():
    """A cylinder walks into the track of one robot and ahead of the other; both feel it where it is now."""
    walker = Cylinder.model_validate(
        {"kind": "cylinder", "center": [2.0, 1.0], "radius": 0.2, "motion": {"path": [[2.0, 2.0, 2.0]]}}
    )
    groups = (team(2, radius=0.1, speed=0.5),)
    places = np.array([[0.4, 2.0], [2.0, 0.5]])
    swarm = Swarm(groups, places, np.array([0.0, np.pi / 2]), empty_arena(), NOWHERE, 0, [walker])
    command(swarm, 0.5, 0.0)
    for tick in range(1, 41):
        swarm.move(tick, 0.1 * tick, 0.1)
        now = swarm.snapshot()["position"]
        body = walker.motion.place(walker.center, 0.1 * tick)
        assert np.hypot(*(now - body).T).min() > 0.3
    # the first one came up to the cylinder that stands in its way, the second one follows it to its place
    np.testing.assert_allclose(now, [[1.7, 2.0], [2.0, 1.7]], atol=0.005)
    assert swarm.blocked.to_numpy().all()
    np.testing.assert_allclose(swarm.velocity.to_numpy(), 0.0, atol=0.01)


def test_velocity_is_what_was_driven():
    swarm = swarm_at([[1.0, 1.0], [2.0, 2.0]], [0.3, 2.0])
    command(swarm, 0.2, 0.5)
    before = swarm.position.to_numpy()
    swarm.move(1, 0.1, 0.1)
    driven = (swarm.position.to_numpy() - before) / 0.1
    np.testing.assert_allclose(swarm.velocity.to_numpy(), driven, atol=1e-5)
    assert np.hypot(*driven.T) == pytest.approx(0.2, rel=1e-3)


def one_robot(**body):
    group = team(1).model_copy(update={"body": Body(**body)})
    return swarm_at([(2.0, 1.5)], [0.0], groups=(group,))


def test_outer_wheel_is_no_faster_than_the_robot():
    """1 m/s and 2 rad/s on wheels 0.4 m apart: the outer one would do 1.4 m/s, so all is 1/1.4 of it."""
    swarm = one_robot(max_speed=1.0, wheel_base=0.4, max_turn_rate_deg=1000)
    command(swarm, 1.0, 2.0)
    swarm.move(1, 0.1, 0.1)
    assert swarm.heading.to_numpy()[0] == pytest.approx(2.0 / 1.4 * 0.1, rel=1e-5)
    chord = 2 * (1.0 / 2.0) * np.sin(0.5 * 2.0 / 1.4 * 0.1)  # of a circle of radius v/w
    assert np.hypot(*(swarm.position.to_numpy()[0] - (2.0, 1.5))) == pytest.approx(chord, rel=1e-4)


def test_speed_changes_no_faster_than_it_can():
    swarm = one_robot(max_speed=1.0, max_acceleration=0.5)
    command(swarm, 1.0, 0.0)
    for tick in range(10):
        swarm.move(tick + 1, 0.1 * (tick + 1), 0.1)
    # speeds 0.05, 0.1, ... 0.5 m/s for 0.1 s each
    assert swarm.position.to_numpy()[0, 0] - 2.0 == pytest.approx(0.1 * 0.05 * 55, rel=1e-4)
    command(swarm, 0.0, 0.0)
    swarm.move(11, 1.1, 0.1)
    assert swarm.velocity.to_numpy()[0, 0] == pytest.approx(0.45, rel=1e-4)


def test_known_robots_bring_their_figures():
    body = Body(kind="roomba_560", max_speed=0.3)
    assert (body.radius, body.max_speed, body.wheel_base) == (0.17, 0.3, 0.235)
    assert Body(kind="momo").max_turn_rate_deg == 90
    assert Body() == Body(kind="free")
