"""No body ever overlaps anything, moves are those of a unicycle, trials are independent."""

import numpy as np
import pytest
import taichi as ti
from driver import Driver

from taichi_plume.agents.columns import COLUMNS, Rows
from taichi_plume.agents.contact import SKIN
from taichi_plume.agents.placement import Placed, place, placed
from taichi_plume.agents.swarm import Swarm
from taichi_plume.grid.kernels import compiled
from taichi_plume.scenario.algorithms import Casting
from taichi_plume.scenario.obstacles import Cylinder
from taichi_plume.scenario.robots import Body, Group
from taichi_plume.scenario.starts import StartArea, StartAt, StartLine

pytestmark = pytest.mark.usefixtures("taichi")

EXTENT = (4.0, 3.0)


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


def team(count, trials=1, name="team", radius=0.08, reach=0.0, speed=1.0, turn=360.0, start=None, **body):
    return Group(
        name=name,
        count=count,
        trials=trials,
        start=start or StartArea(kind="area", low=(0, 0), high=EXTENT),
        algorithm=Casting(kind="casting"),
        body=Body(radius=radius, max_speed=speed, max_turn_rate_deg=turn, **body),
        reach=reach,
    )


NOWHERE = np.empty((0, 2))
AWAY = [-9, -9, 0.1], [-9, -9, 0.1, 0.1]  # disc and plate that are in nobody's way


@pytest.fixture(scope="module")
def arena(taichi):
    return Arena()


@pytest.fixture(scope="module")
def three(arena):
    """Robots of three groups among two sources: tests say what they are like."""
    arena.set(*AWAY)
    groups = [team(1, name=name) for name in "abc"]
    places = np.array([[1, 1], [2, 2], [3, 1]])
    return Driver(Swarm(groups, places, np.zeros(3), arena, np.zeros((2, 2)) - 9, 0))


def put(
    three, positions, headings, disc=AWAY[0], plate=AWAY[1], sources=((-9, -9), (-9, -9)), bodies=None, **body
):
    """Up to three robots at their places, alike or each with its body; others are tiny and out of the way."""
    three.swarm.clearance.set(disc, plate)
    spare = 3 - len(positions)
    groups = [team(1, **one) for one in (bodies or [body] * len(positions))]
    groups += [team(1, radius=0.001) for _ in range(spare)]
    corners = [[3.98, 2.98 - 0.01 * n] for n in range(spare)]
    three.begin(groups, [*positions, *corners], [*headings, *[0.0] * spare], np.array(sources, float))


def command(three, speed, turn_rate):
    """To as many robots as numbers are given, or all alike; those of no interest get the same."""
    three.command(*(np.resize(np.asarray(one, float), 3) for one in (speed, turn_rate)))


def overlap(swarm, arena, position):
    """The deepest overlap [m] of any body with anything, from float64 distances; negative: all are free."""
    p = position.astype(float)
    r = np.concatenate([np.full(g.size, g.model.body.radius, np.float32) for g in swarm.groups]).astype(float)
    worst = (r - arena.distance_at(p)).max()
    for k in range(swarm.trials):
        teams = [g.start + k * g.count + np.arange(g.count) for g in swarm.groups if k < g.trials]
        of_trial = np.concatenate(teams)
        q, s = p[of_trial], r[of_trial]
        apart = np.hypot(*(q[:, None] - q[None]).T)
        np.fill_diagonal(apart, np.inf)
        worst = max(worst, (s[:, None] + s[None] - apart).max())
    return worst


def test_nothing_ever_overlaps(arena):
    """Two groups in 40 trials drive blindly through four scenes, 0.3 m a tick at most; a plate is thin."""
    rng = np.random.default_rng(1)
    groups = (team(6, 40, "small", radius=0.08, speed=0.6), team(3, 25, "large", radius=0.2, speed=3.0))
    driver = None
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
        driver = driver or Driver(Swarm(groups, positions, heading, arena, NOWHERE, 0))
        driver.begin(groups, positions, heading)
        swarm, now = driver.swarm, driver.swarm.snapshot()
        fastest = np.repeat([0.6, 3.0], [240, 75])
        assert overlap(swarm, arena, now["position"]) < 0
        bumps = 0
        for tick in range(80):
            if tick % 8 == 0:
                driver.command(rng.uniform(-0.5, 4, swarm.count), rng.normal(0, 1, swarm.count))
            before = now["position"]
            now = driver.move()
            assert overlap(swarm, arena, now["position"]) < -0.4 * SKIN  # air is left for the rounding
            jump = np.hypot(*(now["position"] - before).T)
            assert (jump <= fastest * 0.1 + 1e-5).all()
            bumps += now["blocked"].sum()
        assert bumps > 100
        assert np.median(now["path_length"]) > 1.0


def test_nobody_passes_through_a_thin_plate_or_another_robot(three):
    for speed in (0.3, 30.0):
        put(
            three,
            [[1.0, 2.0], [1.0, 1.0], [1.6, 1.0]],
            [0, 0, np.pi / 2],
            plate=[2.0, 1.5, 0.001, 1.4],
            speed=100.0,
        )
        command(three, [speed, speed, 0], 0)
        now = three.move(199)
        x = now["position"][:, 0]
        assert x[0] == pytest.approx(2.0 - 0.001 - 0.08, abs=0.003), speed
        assert x[1] == pytest.approx(1.6 - 0.16, abs=0.003), speed
        assert x[2] == pytest.approx(1.6), speed
        assert now["blocked"].tolist() == [1, 1, 0], speed


def test_a_free_robot_drives_a_circle(three):
    """Commands v, w make a circle of radius v/w; after a full turn the robot is back, 2π v/w further."""
    v, w, n = 0.2, 1.0, 90
    dt = 2 * np.pi / (w * n)
    put(three, [[2.0, 1.5]], [0.0])
    three.command([v, 0, 0], [w, 0, 0])
    furthest = 0.0
    for _ in range(n):
        now = three.move(dt=dt)
        center = np.array([2.0, 1.5 + v / w])
        furthest = max(furthest, abs(np.hypot(*(now["position"][0] - center)) - v / w))
    assert furthest < 1e-5
    assert now["position"][0] == pytest.approx([2.0, 1.5], abs=1e-5)
    assert now["heading"][0] == pytest.approx(0, abs=1e-4)
    perimeter = 2 * v / w * n * np.sin(np.pi / n)  # of the polygon through the n points
    assert now["path_length"][0] == pytest.approx(perimeter, rel=1e-5)


def test_commands_are_clipped_to_the_body(three):
    put(three, [[2.0, 1.5], [1.0, 1.5]], [0.0, 0.0], speed=0.2, turn=90.0)
    three.command([9.0, 0.0, 0.0], [0.0, -50.0, 0.0])
    now = three.move()
    assert now["position"][0] == pytest.approx([2.02, 1.5], abs=1e-6)
    assert now["heading"][1] == pytest.approx(-np.pi / 2 * 0.1)


def test_a_robot_slides_along_a_wall(three):
    """Pressed on the wall at 45° it goes on with the tangential part of its speed, and feels the wall."""
    put(three, [[1.0, 0.2]], [-np.pi / 4], speed=0.5)
    command(three, 0.5, 0.0)
    now = three.move(50)
    x, y = now["position"][0]
    assert y == pytest.approx(0.08, abs=0.003)
    assert x == pytest.approx(1.0 + 2.5 * np.cos(np.pi / 4), abs=0.06)
    assert now["blocked"][0] == 1


def test_driving_along_a_wall_is_no_contact(three):
    put(three, [[1.0, 0.0812]], [-0.02], speed=0.5)
    command(three, 0.5, 0.0)
    for _ in range(20):
        now = three.move()
        assert now["blocked"][0] == 0
    assert now["position"][0, 0] == pytest.approx(2.0, abs=0.02)


def test_a_robot_rounds_an_obstacle_it_meets_off_centre(three):
    put(three, [[1.0, 1.55]], [0.0], disc=[2.0, 1.5, 0.3], speed=0.5)
    three.command([0.5, 0.0, 0.0], 0.0)
    assert three.move(100)["position"][0, 0] > 3.5


def test_trials_do_not_interact(arena):
    """Trial 1 of three, alone in a swarm, drives the very same way: the others neither see nor touch it."""
    rng = np.random.default_rng(2)
    arena.set(*AWAY)
    group = team(8, 3)
    positions, headings = place(group, np.random.default_rng, arena.distance_at)
    speeds, turns = rng.uniform(0, 1, (60, 24)), rng.normal(0, 2, (60, 24))
    together = Driver(Swarm((group,), positions, headings, arena, NOWHERE, 0))
    alone = Driver(Swarm((team(8),), positions[8:16], headings[8:16], arena, NOWHERE, 0))
    bumps = 0
    for tick in range(60):
        together.command(speeds[tick], turns[tick])
        alone.command(speeds[tick, 8:16], turns[tick, 8:16])
        now = together.move()
        then = alone.move()
        bumps += then["blocked"].sum()
    assert bumps > 0
    assert (now["position"][8:16] == then["position"]).all()


def test_who_reaches_a_source_stops_there(three):
    places, sources = [[2.0, 1.5], [2.0, 2.5]], [[3.0, 1.5], [0.5, 0.5]]
    put(three, places, [0.0, 0.0], sources=sources, reach=0.36, speed=0.5)
    three.command([0.5, 0.2, 0.0], 0.0)
    snapshot = three.move(39)
    assert snapshot["found"].tolist() == [1, 0, 0]
    assert not three.swarm.all_over()
    # 0.64 m at 0.05 m a tick: reached with tick 13
    assert snapshot["found_time"][0] == pytest.approx(1.3)
    assert np.isnan(snapshot["found_time"][1])
    assert snapshot["position"][0] == pytest.approx([2.65, 1.5], abs=1e-5)
    assert snapshot["path_length"][0] == pytest.approx(0.65, abs=1e-5)


def test_an_empty_swarm_is_fine(arena):
    swarm = Swarm((), NOWHERE, np.empty(0), arena, NOWHERE, 0)
    swarm.move(1, 0.1, 0.1)
    assert swarm.count == 0
    assert swarm.snapshot()["position"].shape == (0, 2)


def test_a_swarm_begins_anew_without_a_kernel(three):
    """With other bodies, places, sources and another seed; and the first beginning comes to the same again."""

    def run(**body):
        put(three, [[1.0, 1.0], [2.0, 1.1]], [0.3, 2.0], sources=[[3.0, 1.5], [0.5, 0.5]], **body)
        three.command([0.4, 0.3, 0.1], [0.2, -0.1, 0.0])
        return three.move(30)

    first = run()
    before = compiled()
    other = run(speed=0.2, radius=0.2, reach=0.5, wheel_base=0.1, max_acceleration=0.1)
    again = run()
    assert compiled() == before
    assert (other["position"] != first["position"]).all(axis=1)[:2].all()
    for name, values in first.items():
        np.testing.assert_array_equal(again[name], values, err_msg=name)


def test_a_swarm_goes_on_from_what_was_saved(three):
    put(three, [[1.0, 1.0], [3.5, 1.1]], [0.3, 0.0], max_acceleration=0.3)
    three.command([0.4, 0.3, 0.1], [0.2, -0.1, 0.0])
    three.move(10)
    saved = three.state.save()
    then = three.move(10)
    three.state.restore(saved)
    three.tick = 10
    for name, values in three.move(10).items():
        np.testing.assert_array_equal(values, then[name], err_msg=name)


def test_columns_are_declared_with_unit_and_meaning(three):
    keys = [column.key for column in COLUMNS if column.key]
    assert len(set(keys)) == len(keys)
    assert three.swarm.snapshot().keys() == {"start", *keys}
    for column in COLUMNS:
        assert column.unit, column.name
        assert column.meaning, column.name
        assert len(column.table) in (0, column.width), column.name
        values = three.swarm.snapshot().get(column.key, column.zeros(3))
        assert (values.dtype, values.shape) == (column.dtype, column.zeros(3).shape), column.name


def test_rows_are_written_as_they_are_read(three):
    columns = [column for column in COLUMNS if column.told] + [COLUMNS[0]]
    rows = Rows(three.swarm, columns, 1, 2)
    values = [np.array([3, -5]), np.array([0.1, 0.2]), np.array([-1, 0.7]), np.array([[1, 2], [3, 4]])]
    first = three.swarm.snapshot()["position"][0]
    rows.write(values)
    for column, wrote, read in zip(columns, values, rows.read(), strict=True):
        np.testing.assert_array_equal(read, wrote.astype(column.dtype), err_msg=column.name)
    np.testing.assert_array_equal(three.swarm.snapshot()["position"], [first, [1, 2], [3, 4]])


def test_places_of_each_kind(arena):
    arena.set(*AWAY)
    distance = arena.distance_at
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
def test_places_that_do_not_work(start, count, message, arena):
    arena.set(*AWAY)
    with pytest.raises(ValueError, match=message):
        place(team(count, start=start), np.random.default_rng, arena.distance_at)


def test_later_groups_keep_clear_of_earlier_ones(arena):
    at = StartAt(kind="positions", positions=((1, 1),))
    arena.set(*AWAY)
    distance = arena.distance_at
    first = team(1, start=at)
    earlier = placed(first, place(first, np.random.default_rng, distance)[0])
    with pytest.raises(ValueError, match="would touch another robot"):
        place(team(1, name="second", start=at), np.random.default_rng, distance, [earlier])


def test_robots_stop_at_what_walks_about(arena):
    """A cylinder walks into the track of one robot and ahead of the other; both feel it where it is now."""
    arena.set(*AWAY)
    walker = Cylinder.model_validate(
        {"kind": "cylinder", "center": [2.0, 1.0], "radius": 0.2, "motion": {"path": [[2.0, 2.0, 2.0]]}}
    )
    groups = (team(2, radius=0.1, speed=0.5),)
    places = np.array([[0.4, 2.0], [2.0, 0.5]])
    driver = Driver(Swarm(groups, places, np.array([0.0, np.pi / 2]), arena, NOWHERE, 0, [walker]))
    driver.command(0.5, 0.0)
    for tick in range(1, 41):
        now = driver.move()
        body = walker.motion.place(walker.center, 0.1 * tick)
        assert np.hypot(*(now["position"] - body).T).min() > 0.3
    # the first one came up to the cylinder that stands in its way, the second one follows it to its place
    np.testing.assert_allclose(now["position"], [[1.7, 2.0], [2.0, 1.7]], atol=0.005)
    assert now["blocked"].all()
    np.testing.assert_allclose(driver.swarm.velocity.to_numpy(), 0.0, atol=0.01)
    smaller = walker.model_copy(update={"radius": 0.05})
    driver.begin(groups, places, np.array([0.0, np.pi / 2]), walkers=[smaller])
    driver.command(0.5, 0.0)
    np.testing.assert_allclose(driver.move(40)["position"], [[1.85, 2.0], [2.0, 1.85]], atol=0.005)


def test_velocity_is_what_was_driven(three):
    put(three, [[1.0, 1.0], [2.0, 2.0]], [0.3, 2.0])
    command(three, 0.2, 0.5)
    before = three.swarm.snapshot()["position"]
    driven = ((three.move()["position"] - before) / 0.1)[:2]
    np.testing.assert_allclose(three.swarm.velocity.to_numpy()[:2], driven, atol=1e-5)
    assert np.hypot(*driven.T) == pytest.approx(0.2, rel=1e-3)


def test_outer_wheel_is_no_faster_than_the_robot(three):
    """1 m/s and 2 rad/s on wheels 0.4 m apart: the outer one would do 1.4 m/s, so all is 1/1.4 of it."""
    put(three, [[2.0, 1.5]], [0.0], wheel_base=0.4, turn=1000)
    command(three, 1.0, 2.0)
    now = three.move()
    assert now["heading"][0] == pytest.approx(2.0 / 1.4 * 0.1, rel=1e-5)
    chord = 2 * (1.0 / 2.0) * np.sin(0.5 * 2.0 / 1.4 * 0.1)  # of a circle of radius v/w
    assert np.hypot(*(now["position"][0] - (2.0, 1.5))) == pytest.approx(chord, rel=1e-4)


def test_speed_changes_no_faster_than_it_can(three):
    put(three, [[2.0, 1.5]], [0.0], max_acceleration=0.5)
    command(three, 1.0, 0.0)
    # speeds 0.05, 0.1, ... 0.5 m/s for 0.1 s each
    assert three.move(10)["position"][0, 0] - 2.0 == pytest.approx(0.1 * 0.05 * 55, rel=1e-4)
    command(three, 0.0, 0.0)
    three.move()
    assert three.swarm.velocity.to_numpy()[0, 0] == pytest.approx(0.45, rel=1e-4)


def test_known_robots_bring_their_figures():
    body = Body(kind="roomba_560", max_speed=0.3)
    assert (body.radius, body.max_speed, body.wheel_base) == (0.17, 0.3, 0.235)
    assert Body(kind="momo").max_turn_rate_deg == 90
    assert Body() == Body(kind="free")
