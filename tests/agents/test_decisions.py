"""Decision quantities of all search algorithms, compared with what papers and definitions say in constructed cases."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from arena import TICK, Run, Script
from robots import Air
from test_dapso import Hill
from test_hit_map import information
from test_infotaxis import MODEL as INFOTAXIS
from test_infotaxis import Bayes, entropy
from test_particle_filter import WIND, Windy

from taichi_plume.agents import decisions
from taichi_plume.agents.algorithm_table import ALGORITHMS
from taichi_plume.agents.columns import COLUMNS
from taichi_plume.agents.potential import NEAR
from taichi_plume.agents.sweep import lanes
from taichi_plume.agents.tracking import LEAVE, RISE
from taichi_plume.scenario.plume_tracking import SurgeSpiral
from taichi_plume.scenario.robots import Communication
from taichi_plume.scenario.search_algorithm import Spiral

pytestmark = pytest.mark.usefixtures("taichi")

QUICK = {"acquisition": 1.0, "settle": 0.0}


def seen(run):
    """Decision quantities of all robots by name."""
    return decisions.values(run.teams, run.swarm.count)


def after_acquisitions(run, count):
    """Decision quantities of robot 0 after each of so many acquisitions, and its position at that time."""
    result = []
    for n in range(count):
        while run.swarm.acquisitions.to_numpy()[0] == n:
            run.step()
        values = {name: float(each[0]) for name, each in seen(run).items()}
        result.append((values, run.swarm.position.to_numpy()[0]))
    return result


def test_a_name_means_the_same_in_all_algorithms():
    taken = {name for column in COLUMNS for name in (column.key, *column.table)}
    known: dict[str, tuple] = {}
    for kind, algorithm in ALGORITHMS.items():
        names = [each.name for each in algorithm.DECISIONS]
        assert len(set(names)) == len(names), kind
        assert bool(names) == (kind != "external"), kind
        assert not taken & set(names), kind
        for each in algorithm.DECISIONS:
            meant = each.unit, each.meaning
            assert all(meant), (kind, each.name)
            assert known.setdefault(each.name, meant) == meant, (kind, each.name)


def test_the_page_of_the_algorithms_lists_them():
    kinds: dict[decisions.Decision, list[str]] = {}
    for kind, algorithm in ALGORITHMS.items():
        for each in algorithm.DECISIONS:
            kinds.setdefault(replace(each, source="", axis=None, none=0.0), []).append(kind)
    rows = [f"| `{e.name}` | {e.unit} | {e.meaning} | {', '.join(kinds[e])} |" for e in kinds]
    page = (Path(__file__).parents[2] / "docs/models/algorithms.md").read_text(encoding="utf-8")
    assert rows == page.partition("| column | unit |")[2].splitlines()[2 : len(rows) + 2]


@pytest.mark.slow
def test_spiral():
    """Constant levels c have PI = 2 c. Two hits; five misses, of which three are low; two more, and an escape."""
    levels = [1.0, 2.0, 1.5, 0.5, 0.5, 0.5, 0.3, 0.3, 0.5]
    run = Run(Spiral(kind="spiral", minimum_ppm=1.0, arms=(0.1,) * 6), Script([0.0], 1.0))
    assert np.isnan([seen(run)[name][0] for name in ("proximity_index", "index_needed", "index_hit")]).all()
    rows = []
    for n, level in enumerate(levels):
        run.gas.tell([level], 1.0)
        while run.swarm.acquisitions.to_numpy()[0] == n:
            run.step()
        rows.append([float(values[0]) for values in seen(run).values()])
    expected = [  # PI, needed, hit, T_PI, misses, low misses, arm, escapes
        [2.0, 1.0, 1, 2.0, 0, 0, 0, 0],
        [4.0, 2.0, 1, 4.0, 0, 0, 0, 0],
        [3.0, 4.0, 0, 4.0, 1, 0, 1, 0],
        [1.0, 4.0, 0, 4.0, 2, 1, 2, 0],
        [1.0, 4.0, 0, 4.0, 3, 2, 3, 0],
        [1.0, 4.0, 0, 0.8, 0, 0, 4, 0],
        [0.6, 0.8, 0, 0.8, 1, 0, 5, 0],
        [0.6, 0.8, 0, 1.0, 0, 0, 6, 1],
        [1.0, 1.0, 1, 1.0, 0, 0, 0, 1],
    ]
    assert np.array(rows) == pytest.approx(np.array(expected), rel=1e-5)


@pytest.mark.slow
def test_ecoli():
    run = Run({"kind": "ecoli", **QUICK}, Script([1.0], 1.0), positions=((10.0, 10.0),), size=(20.0, 20.0))
    means, rises, turned = [], [], []
    before, course = run.swarm.position.to_numpy()[0], np.nan
    for n, level in enumerate([1.0, 3.0, 2.0, 2.0]):
        run.gas.tell([level], 1.0)
        ((values, here),) = after_acquisitions(run, n + 1)[n:]
        means.append(values["mean_ppm"])
        rises.append(values["rise_ppm"])
        if n:
            turned.append(np.cos(np.arctan2(*(here - before)[::-1]) - course))
        before, course = here, values["course"]
    assert means == pytest.approx([1.0, 3.0, 2.0, 2.0])
    assert rises == pytest.approx([np.nan, 2.0, -1.0, 0.0], nan_ok=True)
    assert turned == pytest.approx([1.0] * 3, abs=1e-3)  # it drove where the column says


@pytest.mark.slow
def test_random_walk():
    run = Run({"kind": "random_walk"}, Script([0.0], 1.0), positions=((10.0, 10.0),), size=(20.0, 20.0))
    run.step()
    corners, segments = [run.swarm.position.to_numpy()[0]], [seen(run)]
    for _ in range(600):
        run.step()
        now = seen(run)
        if now["course"][0] != segments[-1]["course"][0]:
            corners.append(run.swarm.position.to_numpy()[0])
            segments.append(now)
    ways = np.diff(corners, axis=0)
    assert len(ways) > 3
    course, length = (np.array([each[name][0] for each in segments[:-1]]) for name in ("course", "segment_m"))
    expected = length[:, None] * np.column_stack([np.cos(course), np.sin(course)])
    assert ways == pytest.approx(expected, abs=0.02)


WIDE = {"positions": ((20.0, 20.0),), "size": (40.0, 40.0)}
PROMPT = {"gas": {"kind": "ideal", "period": TICK}, "wind": {"kind": "ideal"}}


def state_of(run):
    return run.teams[0].algorithm.STATE_NAMES[run.swarm.state.to_numpy()[0]]


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["casting", "surge_cast", "surge_spiral", "particle_filter"])
def test_plume_trackers_detect(kind):
    """In random gas: each detection and the reading that it needed, from the readings since the plume was entered."""
    threshold, fraction = 5.0, 0.5
    levels = np.random.default_rng(5).uniform(0.0, 20.0, 300)
    model = {"kind": kind, "threshold_ppm": threshold, "peak_fraction": fraction}
    run = Run(model, Windy(levels, 0.3), sensors=PROMPT, **WIDE)
    peak, trough, inside = 0.0, 0.0, False
    outcomes = set()
    for _ in range(500):
        run.step()
        c = float(run.swarm.reading.to_numpy()[0])
        now = {name: float(values[0]) for name, values in seen(run).items()}
        if inside:
            peak, trough = max(peak, c), c
            needed = max(LEAVE * threshold, fraction * peak)
        else:
            trough = min(trough, c)
            needed = max(threshold, RISE * trough)
            peak = c
        assert now["needed_ppm"] == pytest.approx(needed, rel=1e-6)
        outcomes.add((inside, c >= needed))
        state, outside = state_of(run), not inside
        inside = state in ("IN_PLUME", "SURGE") or (state == "GO" and c >= needed)
        if outside:
            assert inside == (c >= now["needed_ppm"])
    assert len(outcomes) == 4
    assert [now["upwind_x"], now["upwind_y"]] == pytest.approx(-WIND / np.linalg.norm(WIND), abs=1e-3)


def lost(kind, seconds, **model):
    """States and decision quantities of a robot at each tick after gas for a second, in wind along x."""
    gas = Windy([10.0, 0.0], 1.0)
    run = Run({"kind": kind, "threshold_ppm": 5.0, **model}, gas, sensors=PROMPT, **WIDE)
    ticks = []
    for _ in range(round(seconds / TICK)):
        run.step()
        now = {name: float(values[0]) for name, values in seen(run).items()}
        ticks.append((state_of(run), now, run.swarm.position.to_numpy()[0]))
    return ticks


def changes(values):
    """Values without repetitions."""
    return [b for a, b in zip([None, *values], values, strict=False) if a != b]


@pytest.mark.slow
def test_casting_sweeps_double():
    ticks = lost("casting", 60)
    sweeps = changes(
        [(now["cast_m"], now["failed_casts"], now["cast_side"]) for s, now, _ in ticks if s == "LOST"]
    )
    lengths, failed, sides = zip(*sweeps, strict=True)
    assert lengths == pytest.approx([0.6, 1.2, 2.4, 4.8])
    assert failed == (0, 1, 2, 3)
    assert sides in ((1, -1, 1, -1), (-1, 1, -1, 1))
    assert np.isnan(ticks[0][1]["cast_m"])


@pytest.mark.slow
def test_surge_cast_segments():
    """To 0.4 m from where the plume was lost, as far to the other side, 0.8 m to each side, 1.6 m."""
    ticks = lost("surge_cast", 75)
    segments = changes([(now["cast_segment"], now["cast_m"]) for s, now, _ in ticks if s == "CAST"])
    numbers, lengths = zip(*segments, strict=True)
    assert numbers == (0, 1, 2, 3, 4, 5)
    assert lengths == pytest.approx([0.4, 0.8, 1.2, 1.6, 2.4, 3.2])


@pytest.mark.slow
def test_surge_spiral_angle():
    """r = gap phi / 2 pi from where the plume was lost."""
    ticks = [(now["spiral_angle"], x) for s, now, x in lost("surge_spiral", 60) if s == "SPIRAL"]
    angles, places = np.array([phi for phi, _ in ticks]), np.array([x for _, x in ticks])
    radius = np.linalg.norm(places - places[0], axis=1)
    late = angles > 2 * np.pi
    assert late.sum() > 50
    gap = SurgeSpiral(kind="surge_spiral").gap
    assert radius[late] == pytest.approx(gap * angles[late] / (2 * np.pi), abs=0.05)


@pytest.mark.slow
def test_particle_filter():
    """The estimate is the mean of the weighted particles; before the first detection there is none."""
    levels = np.repeat([0.0, 10.0, 0.0, 10.0], 20)
    run = Run({"kind": "particle_filter", "threshold_ppm": 5.0}, Windy(levels, 0.2), sensors=PROMPT)
    runs = set()
    for tick in range(200):
        run.step()
        now = {name: values[0] for name, values in seen(run).items()}
        runs.add(now["filter_runs"])
        estimate = [now["estimate_x"], now["estimate_y"]]
        assert np.isnan([*estimate, now["belief_spread_m"]]).all() == (now["filter_runs"] == 0.0)
        if tick == 39:  # two ticks of an update later particles may have been drawn again
            weight, particle = run.algorithm.weight.to_numpy()[0], run.algorithm.particle.to_numpy()[0]
            assert now["estimates"] >= 1.0
            mean = weight @ particle
            assert estimate == pytest.approx(mean, abs=0.05)
            square = weight @ ((particle - mean) ** 2).sum(axis=1)
            assert now["belief_spread_m"] == pytest.approx(np.sqrt(square), rel=0.1)
    assert runs == {0.0, 1.0}


@pytest.mark.slow
def test_dapso():
    """A team of two on a hill: the best of each robot, and of both as soon as the other's message has arrived."""
    keys = {"threshold_ppm": 5.0, "memory": 0, "restart_after": 0, "sample_period": TICK}
    model = {"kind": "dapso", "neighbourhood": {"kind": "search_space", "distance": 50.0}, **QUICK, **keys}
    starts = ((0.4, 0.4), (0.8, 0.4))
    run = Run(
        model, Hill([100.0], 1.0), starts, size=(4.0, 3.0), communication=Communication(range=None), reach=0
    )
    best, place, known = np.full(2, -1.0), np.zeros((2, 2)), np.full((2, 3), np.nan)
    odour = set()
    assert np.isnan([values for name, values in seen(run).items() if name != "short_steps"]).all()
    done = np.zeros(2)
    for _ in range(600):
        here = run.swarm.believed_position.to_numpy()
        run.step()
        now, count = seen(run), run.swarm.acquisitions.to_numpy()
        said, said_at = best.copy(), place.copy()
        for n in np.flatnonzero(count > done):
            if now["mean_ppm"][n] >= best[n]:
                best[n], place[n] = now["mean_ppm"][n], here[n]
            known[n] = (said[1 - n], *said_at[1 - n]) if said[1 - n] > best[n] else (best[n], *place[n])
        done = count
        measured = np.flatnonzero(count > 0)
        own = np.column_stack([now[name] for name in ("own_best_ppm", "own_best_x", "own_best_y")])
        assert own[measured] == pytest.approx(np.column_stack([best, place])[measured], abs=1e-3)
        both = np.column_stack([now[name] for name in ("known_best_ppm", "known_best_x", "known_best_y")])
        assert both[measured] == pytest.approx(known[measured], abs=1e-3)
        assert (now["odour_known"][measured] == (known[measured, 0] >= 5.0)).all()
        odour |= set(now["odour_known"][measured])
    assert odour == {0.0, 1.0}
    assert (best > 30.0).all()


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["infotaxis", "space_aware_infotaxis"])
def test_infotaxis(kind):
    """Entropy, expectation and choice after each of four acquisitions, against a posterior in f64."""
    reach, radius, size = 0.35, 0.085, np.array([3.0, 2.1])
    model = INFOTAXIS.model_dump() | {"kind": kind}
    hits = [0.0, 1.0, 0.0, 1.0]
    run = Run(model, Script([0.0], 1.0), positions=((1.5, 1.0),), found="reached", reach=reach)
    bayes = Bayes(run.algorithm)
    for n, hit in enumerate(hits):
        run.gas.tell([9.0 * hit], 1.0)
        while run.swarm.acquisitions.to_numpy()[0] == n:
            here = run.swarm.position.to_numpy()[0].astype(float)
            run.step()
        now = {name: float(values[0]) for name, values in seen(run).items()}
        bayes.learn(here, bool(hit), reach)
        p = bayes.p
        assert now["detection"] == hit
        assert now["mean_ppm"] == pytest.approx(9.0 * hit)
        assert now["entropy"] == pytest.approx(entropy(p), rel=1e-3)
        mean = np.array([(p * bayes.X).sum(), (p * bayes.Y).sum()])
        square = (p * ((bayes.X - mean[0]) ** 2 + (bayes.Y - mean[1]) ** 2)).sum() + INFOTAXIS.cell**2 / 6
        assert now["belief_spread_m"] == pytest.approx(np.sqrt(square), rel=1e-3)
        costs = {}
        for move, way in enumerate([(1, 0), (0, 1), (-1, 0), (0, -1), (0, 0)]):
            there = here + INFOTAXIS.step * np.array(way)

            def steps_left(q, there=there):
                way = np.abs(bayes.X - there[0]) + np.abs(bayes.Y - there[1])
                places = np.exp(entropy(q)) * (INFOTAXIS.cell / INFOTAXIS.step) ** 2
                return np.log2((q * way).sum() / INFOTAXIS.step + places / 2 - 0.5)

            if (there >= radius).all() and (there <= size - radius).all():
                value = entropy if kind == "infotaxis" else steps_left
                costs[move] = bayes.expected(there, reach, value)
        expected = costs[int(now["chosen_move"])]
        assert expected == pytest.approx(min(costs.values()), rel=1e-3)
        if kind == "infotaxis":
            assert now["expected_entropy"] == pytest.approx(expected, rel=1e-3)
            assert now["expected_gain"] == pytest.approx(entropy(p) - expected, abs=4e-3)
            assert now["expected_gain"] > 0.0
        else:
            assert now["expected_cost"] == pytest.approx(expected, rel=1e-3)


@pytest.mark.slow
def test_hit_map():
    """The cell with the most information per time, to which the robot drives; none once the belief is sure."""
    model = {"kind": "hit_map", "cell": 0.2, "speed": 0.2, "converged": 0.01, **QUICK}
    run = Run(model, Script([0.0, 9.0, 0.0], 4.0), positions=((1.5, 1.0),), found="declared")
    algorithm = run.algorithm
    assert np.isnan([values[0] for values in seen(run).values()]).all()
    goal, hits = None, []
    for n in range(5):
        ((now, here),) = after_acquisitions(run, n + 1)[n:]
        hits.append(now["detection"])
        assert hits[-1] == float(now["mean_ppm"] >= algorithm.model.threshold_ppm)
        assert now["entropy"] == pytest.approx(entropy(algorithm.beliefs()[0].astype(float)), rel=1e-3)
        if goal is not None:
            assert np.linalg.norm(here - goal) < 0.1
        goal = np.array([now["way_point_x"], now["way_point_y"]])
        start, there = (int(x / 0.2) * algorithm.columns + int(y / 0.2) for x, y in (here, goal))
        way = algorithm.roads.length.to_numpy()[start]
        near = np.flatnonzero((way <= algorithm.model.range) & (np.arange(len(way)) != start))
        rate = [information(algorithm, int(c), 0.0, 0.0) / (1.0 + way[c] / 0.2) for c in near]
        assert now["information"] == pytest.approx(max(rate), rel=1e-3)
        assert rate[list(near).index(there)] == pytest.approx(max(rate), rel=1e-3)
    assert set(hits) == {0.0, 1.0}
    sure = Run(model | {"converged": 50.0}, Script([0.0], 4.0), positions=((0.5, 0.5),), found="declared")
    ((now, here),) = after_acquisitions(sure, 1)
    assert np.isnan(now["information"])  # to the mean, in the middle of the floor but for the one miss
    assert [now["way_point_x"], now["way_point_y"]] == pytest.approx([1.5, 1.05], abs=0.25)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["least_known", "sweep"])
def test_way_points_are_reached(kind):
    run = Run({"kind": kind}, Script([0.0], 1.0), positions=((0.5, 0.5),))
    run.step()
    goals, places = [], []
    for _ in range(900):
        now = seen(run)
        goals.append((now["way_point_x"][0], now["way_point_y"][0]))
        places.append(run.swarm.position.to_numpy()[0])
        run.step()
    ends = np.flatnonzero((np.diff(goals, axis=0) != 0).any(axis=1))
    assert len(ends) > 3
    gaps = np.linalg.norm(np.array(goals)[ends] - np.array(places)[ends], axis=1)
    assert gaps.max() < NEAR + 0.2 * TICK
    if kind == "sweep":
        axis, number = run.algorithm.model.lanes((3.0, 2.1), 1)
        room = 0.085 + run.algorithm.model.avoidance
        (way,) = lanes(np.array([[0.5, 0.5]]), np.array([3.0, 2.1]), axis, number, room)
        passed = changes(goals)
        assert np.array(passed) == pytest.approx(way[: len(passed)], abs=1e-5)


@pytest.mark.slow
def test_lineup():
    """Wind along x: ranks by x, the line's middle at the mean of the robots' y, and its tilt by their slope."""
    starts = np.array([(0.6, 0.3), (0.3, 0.3), (0.9, 0.6), (0.3, 0.7)])
    run = Run({"kind": "lineup"}, Air(), starts, size=(4.0, 3.0))
    run.gas.u[None] = (0.7, 0.0)
    while state_of(run) != "SWEEP":
        run.step()
    for _ in range(12):  # up to the first turn
        run.go(1.0)
        now, place = seen(run), run.swarm.position.to_numpy()
        assert now["rank"].tolist() == [2, 0, 3, 1]
        if state_of(run) == "SWEEP":
            middle = place[:, 1].mean() - 1.5  # the robots lag behind the line
            assert now["line_across_m"] == pytest.approx(np.full(4, middle), abs=0.1)
            slope = np.polyfit(place[:, 0], place[:, 1], 1)[0]
            assert (now["line_tilt"] == -np.sign(slope)).all()
        assert (now["late_s"] < 5.0).all()


def test_robots_of_other_algorithms_have_none():
    """Two kinds: each has its own columns, and both share that of way points."""
    rivals = [{"algorithm": {"kind": kind}} for kind in ("sweep", "least_known", "random_walk")]
    run = Run(rivals, Script([0.0], 1.0))
    run.step()
    known = {name: np.isfinite(values).tolist() for name, values in seen(run).items()}
    sweep, least_known, random_walk = np.eye(3, dtype=bool)
    assert known == {
        **{name: (sweep | least_known).tolist() for name in ("way_point_x", "way_point_y")},
        **{name: random_walk.tolist() for name in ("course", "segment_m")},
    }
