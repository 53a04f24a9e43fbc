"""Moves are those of a unicycle, contact stops them, trials are independent; `test_overlap` drives blindly."""

import numpy as np
import pytest
from robots import AWAY, EXTENT, NOWHERE, Arena, Driver, group

from taichi_plume.agents.columns import COLUMNS, Rows
from taichi_plume.agents.placement import place, placed
from taichi_plume.agents.swarm import Swarm
from taichi_plume.engine.program import compiled
from taichi_plume.grid.state import State
from taichi_plume.scenario.obstacles import Cylinder
from taichi_plume.scenario.robots import Body

pytestmark = pytest.mark.usefixtures("taichi")


def team(count, trials=1, name="team", radius=0.08, reach=0.0, speed=1.0, turn=360.0, start=None, **body):
    return group(
        count=count,
        trials=trials,
        name=name,
        reach=reach,
        start=start or {"kind": "area", "low": (0, 0), "high": EXTENT},
        body={"radius": radius, "max_speed": speed, "max_turn_rate_deg": turn, **body},
    )


@pytest.fixture(scope="module")
def arena(taichi):
    return Arena()


@pytest.fixture(scope="module")
def three(arena):
    """Robots of three groups among two sources: tests say what they are like."""
    arena.set()
    groups = [team(1, name=name) for name in "abc"]
    places = np.array([[1, 1], [2, 2], [3, 1]])
    return Driver(Swarm(groups, places, np.zeros(3), arena, np.zeros((2, 2)) - 9, 0))


def put(three, positions, headings, disc=AWAY[0], plate=AWAY[1], sources=((-9, -9), (-9, -9)), **body):
    """Up to three robots at their places; others are tiny and out of the way."""
    three.swarm.clearance.set(disc, plate)
    spare = 3 - len(positions)
    groups = [team(1, **body) for _ in positions]
    groups += [team(1, radius=0.001) for _ in range(spare)]
    corners = [[3.98, 2.98 - 0.01 * n] for n in range(spare)]
    three.begin(groups, [*positions, *corners], [*headings, *[0.0] * spare], np.array(sources, float))


def test_nobody_passes_through_a_thin_plate_or_another_robot(three):
    for speed in (0.3, 30.0):
        places = [[1.0, 2.0], [1.0, 1.0], [1.6, 1.0]]
        put(three, places, [0, 0, np.pi / 2], plate=[2.0, 1.5, 0.001, 1.4], speed=100.0)
        three.command([speed, speed, 0], 0)
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
    three.command(0.5, 0.0)
    now = three.move(50)
    x, y = now["position"][0]
    assert y == pytest.approx(0.08, abs=0.003)
    assert x == pytest.approx(1.0 + 2.5 * np.cos(np.pi / 4), abs=0.06)
    assert now["blocked"][0] == 1


def test_driving_along_a_wall_is_no_contact(three):
    put(three, [[1.0, 0.0812]], [-0.02], speed=0.5)
    three.command(0.5, 0.0)
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
    arena.set()
    eight = team(8, 3)
    positions, headings = place(eight, np.random.default_rng, arena.distance_at)
    speeds, turns = rng.uniform(0, 1, (60, 24)), rng.normal(0, 2, (60, 24))
    together = Driver(Swarm((eight,), positions, headings, arena, NOWHERE, 0))
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
    state = State(three.swarm)
    saved = state.save()
    then = three.move(10)
    state.restore(saved)
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
    columns = [column for column in COLUMNS if column.written_as] + [COLUMNS[0]]
    rows = Rows(three.swarm, columns, 1, 2)
    values = [np.array([3, -5]), np.array([0.1, 0.2]), np.array([-1, 0.7]), np.array([[1, 2], [3, 4]])]
    first = three.swarm.snapshot()["position"][0]
    rows.write(values)
    for column, wrote, read in zip(columns, values, rows.read(), strict=True):
        np.testing.assert_array_equal(read, wrote.astype(column.dtype), err_msg=column.name)
    np.testing.assert_array_equal(three.swarm.snapshot()["position"], [first, [1, 2], [3, 4]])


def test_places_of_each_kind(arena):
    arena.set()
    distance = arena.distance_at
    line = {"kind": "line", "begin": (1, 1), "end": (1, 2), "heading_deg": 90}
    positions, headings = place(team(3, 2, start=line), np.random.default_rng, distance)
    assert positions == pytest.approx(np.array([[1, 1], [1, 1.5], [1, 2]] * 2))
    assert headings == pytest.approx(np.pi / 2)

    given = {"kind": "positions", "positions": ((1, 1), (2, 2))}
    positions, headings = place(team(2, 2, start=given), np.random.default_rng, distance)
    assert positions == pytest.approx(np.array([[1, 1], [2, 2]] * 2))
    assert len(np.unique(headings)) == 4

    area = {"kind": "area", "low": (1, 1), "high": (2, 2)}
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


def at(*positions):
    return {"kind": "positions", "positions": positions}


@pytest.mark.parametrize(
    ("start", "count", "message"),
    [
        (at((1, 1)), 2, "2 robots need as many positions, got 1"),
        (at((1, 0.05)), 1, "would touch a wall or an obstacle"),
        (at((1, 1), (1.1, 1)), 2, r"robot 1 .* would touch another robot"),
        ({"kind": "area", "low": (1, 1), "high": (1.2, 1.2)}, 9, "only [1-4] of 9 robots of radius"),
        (at((2, 2)), 1, "would touch another robot"),
    ],
)
def test_places_that_do_not_work(start, count, message, arena):
    """Beside a group that stands at (2, 2)."""
    arena.set()
    earlier = placed(team(1), np.array([[2.0, 2.0]]))
    with pytest.raises(ValueError, match=message):
        place(team(count, start=start), np.random.default_rng, arena.distance_at, [earlier])


def test_robots_stop_at_what_walks_about(arena):
    """A cylinder walks into the track of one robot and ahead of the other; both feel it where it is now."""
    arena.set()
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
    three.command(0.2, 0.5)
    before = three.swarm.snapshot()["position"]
    driven = ((three.move()["position"] - before) / 0.1)[:2]
    np.testing.assert_allclose(three.swarm.velocity.to_numpy()[:2], driven, atol=1e-5)
    assert np.hypot(*driven.T) == pytest.approx(0.2, rel=1e-3)


def test_outer_wheel_is_no_faster_than_the_robot(three):
    """1 m/s and 2 rad/s on wheels 0.4 m apart: the outer one would do 1.4 m/s, so all is 1/1.4 of it."""
    put(three, [[2.0, 1.5]], [0.0], wheel_base=0.4, turn=1000)
    three.command(1.0, 2.0)
    now = three.move()
    assert now["heading"][0] == pytest.approx(2.0 / 1.4 * 0.1, rel=1e-5)
    chord = 2 * (1.0 / 2.0) * np.sin(0.5 * 2.0 / 1.4 * 0.1)  # of a circle of radius v/w
    assert np.hypot(*(now["position"][0] - (2.0, 1.5))) == pytest.approx(chord, rel=1e-4)


def test_speed_changes_no_faster_than_it_can(three):
    put(three, [[2.0, 1.5]], [0.0], max_acceleration=0.5)
    three.command(1.0, 0.0)
    # speeds 0.05, 0.1, ... 0.5 m/s for 0.1 s each
    assert three.move(10)["position"][0, 0] - 2.0 == pytest.approx(0.1 * 0.05 * 55, rel=1e-4)
    three.command(0.0, 0.0)
    three.move()
    assert three.swarm.velocity.to_numpy()[0, 0] == pytest.approx(0.45, rel=1e-4)


def test_known_robots_bring_their_figures():
    body = Body(kind="roomba_560", max_speed=0.3)
    assert (body.radius, body.max_speed, body.wheel_base) == (0.17, 0.3, 0.235)
    assert Body(kind="momo").max_turn_rate_deg == 90
    assert Body() == Body(kind="free")
