"""The line-up: its geometry, speed, turns and patience."""

import numpy as np
import pytest
from arena import TICK, Run
from robots import Air

from taichi_plume.agents.lineup import FEEL, FORM, SWEEP, WAIT
from taichi_plume.scenario.algorithms import LineUp

pytestmark = pytest.mark.usefixtures("taichi")

FLOOR = (4.0, 3.0)
CORNER = ((0.3, 0.3), (0.6, 0.3), (0.3, 0.6), (0.6, 0.6))
MIDDLE = ((2.0, 1.5), (2.5, 1.5), (1.5, 1.5), (1.0, 1.4))
ANGLES = (90, 180, 30)


def lineup(**keys):
    return LineUp(kind="lineup", **keys)


RIVALS = {
    "default": {"algorithm": lineup()},
    "slow": {"algorithm": lineup(line_speed=0.08)},
    "mirror": {"algorithm": lineup(mirror=True)},
    "impatient": {"algorithm": lineup(patience=6.0)},
    **{
        f"given {angle}": {"algorithm": lineup(wind_direction_deg=angle, spacing=0.6), "positions": MIDDLE}
        for angle in ANGLES
    },
    "measured": {"algorithm": lineup(spacing=0.6), "positions": MIDDLE},
}
NARROW = {
    "slanted": {"algorithm": lineup(stagger=0.5), "positions": CORNER},
    "lone": {"algorithm": lineup(line_speed=0.2), "positions": ((2.0, 0.5),)},
}


def blow(run, wind, seconds):
    """States and places in this wind [m/s], from the start on."""
    run.gas.u[None] = wind
    run.begin(list(RIVALS.values()))
    return run.go(seconds)


def of(run, name):
    """The robots of a rival on FLOOR."""
    return run.of(list(RIVALS).index(name))


@pytest.fixture(scope="module")
def run(taichi):
    """Lines on FLOOR that neither see nor touch each other."""
    return Run(list(RIVALS.values()), Air(), CORNER, 1, FLOOR)


@pytest.fixture(scope="module")
def swept(run):
    """States and places in 150 s of wind along x, by the name of the rival."""
    states, places = blow(run, (0.7, 0.0), 150)
    return {name: (states[:, of(run, name)], places[:, of(run, name)]) for name in RIVALS}


def test_the_line_is_diagonal_with_equal_gaps(swept):
    """From margin to margin along the wind, 0.3 m from each to the next across it; the robots keep their order."""
    states, places = swept["default"]
    first = np.flatnonzero(states[:, 0] == SWEEP)[0]
    line = places[first + 50]
    line = line[np.argsort(line[:, 0])]
    gaps = np.diff(line, axis=0)
    assert gaps[:, 0] == pytest.approx([3.4 / 3] * 3, abs=0.02)
    assert gaps[:, 1] == pytest.approx([-0.3] * 3, abs=0.02)  # the upwind end leads to the far side
    assert np.linalg.norm(gaps, axis=1) == pytest.approx([np.hypot(3.4 / 3, 0.3)] * 3, abs=0.02)
    assert line[:, 0].mean() == pytest.approx(2.0, abs=0.02)
    assert (np.argsort(places[first + 50][:, 0]) == np.argsort(np.array(CORNER)[:, 0], kind="stable")).all()


def test_it_moves_at_its_speed_from_margin_to_margin(swept):
    states, places = swept["slow"]
    sweeping = (states == SWEEP).all(axis=1)
    middle = places[:, :, 1].mean(axis=1)
    steps = np.diff(middle)[sweeping[1:] & sweeping[:-1]]
    assert np.median(np.abs(steps)) / TICK == pytest.approx(0.08, rel=0.02)
    assert places[:, :, 1].min() == pytest.approx(0.3, abs=0.06)
    assert places[:, :, 1].max() == pytest.approx(2.7, abs=0.06)
    turns = np.count_nonzero(np.diff(np.sign(steps[np.abs(steps) > 1e-3])))
    assert turns >= 2
    order = states[np.flatnonzero(np.diff(states[:, 0], prepend=-1)), 0]
    assert order[:3].tolist() == [FEEL, FORM, SWEEP]


@pytest.mark.parametrize("mirror", [False, True])
def test_the_line_mirrors_itself_where_reported(swept, mirror):
    states, places = (values[:1100] for values in swept["mirror" if mirror else "default"])
    middle = places[:, :, 1].mean(axis=1)
    sweeping = (states == SWEEP).all(axis=1)[1:]
    back = np.flatnonzero(sweeping & (np.diff(middle) < -0.005))
    line = places[back[30]]
    tilt = np.sign(np.diff(line[np.argsort(line[:, 0])][:, 1]))
    assert (tilt == (1 if mirror else -1)).all()
    forms = np.count_nonzero(np.diff((states[:, 0] == FORM).astype(int)) == 1)
    assert (forms > 1) == mirror


@pytest.mark.parametrize("angle", ANGLES)
@pytest.mark.parametrize("reported", [True, False])
def test_the_line_lies_along_the_wind(swept, run, angle, reported):
    """Given, whatever wind it feels, or measured; across the wind neighbours are staggered by 0.3 m."""
    w = np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])
    if reported:
        states, places = swept[f"given {angle}"]
    else:
        states, places = (values[:, of(run, "measured")] for values in blow(run, 0.5 * w, 70))
    assert (states == FEEL).any() == (not reported)
    across = (places - [2.0, 1.5]) @ [-w[1], w[0]]
    in_the_middle = (states[:, 0] == SWEEP) & (np.abs(across.mean(axis=1)) < 0.05)
    line = places[np.flatnonzero(in_the_middle)[0]]
    line = line[np.argsort(line @ w)]
    assert np.diff(line @ w) == pytest.approx([0.6] * 3, abs=0.05)
    assert np.abs(np.diff(line @ [-w[1], w[0]])) == pytest.approx([0.3] * 3, abs=0.05)


def test_it_waits_for_a_straggler_but_not_for_ever(run):
    line = of(run, "impatient")
    assert blow(run, (0.7, 0.0), 60)[0][-1, line.start] == SWEEP
    run.swarm.found[line.start + 2] = 1  # it stands
    states, places = (values[:, line] for values in run.go(60))
    waiting = states[:, 0] == WAIT
    assert waiting.sum() * TICK == pytest.approx(6.0, abs=1.0)
    others = places[:, [0, 1, 3]]
    stand = np.flatnonzero(waiting)[-1]
    assert np.abs(others[stand] - others[stand - 20]).max() < 0.01
    assert np.abs(others[-1] - others[stand]).max() > 0.5


@pytest.fixture(scope="module")
def narrow(taichi):
    """States and places of the rivals in a room of 4 x 1.4 m."""
    run = Run(list(NARROW.values()), Air(), size=(4.0, 1.4))
    run.gas.u[None] = 0.7, 0.0
    states, places = run.go(200)
    return {name: (states[:, run.of(n)], places[:, run.of(n)]) for n, name in enumerate(NARROW)}


def test_in_a_narrow_room_the_line_is_less_slanted(narrow):
    states, places = (values[:800] for values in narrow["slanted"])
    assert (states == SWEEP).any()
    line = places[np.flatnonzero(states[:, 0] == SWEEP)[0] + 20]
    assert np.abs(np.diff(line[np.argsort(line[:, 0])][:, 1])) == pytest.approx([0.4 / 3] * 3, abs=0.02)
    assert places[:, :, 1].max() < 1.1 + 0.06


def test_a_lone_robot_steps_upwind_after_each_sweep(narrow):
    x, y = narrow["lone"][1][300:, 0].T
    assert y.min() < 0.36
    assert y.max() > 1.04
    levels = np.unique(np.round((3.7 - x[np.abs(y - 0.7) < 0.02]) / 0.3, 1))
    assert levels == pytest.approx(np.round(levels), abs=0.11)
    assert len(np.unique(np.round(levels))) >= 4


def test_without_wind_the_line_lies_along_x(run):
    states, places = (values[:, of(run, "default")] for values in blow(run, (0.0, 0.0), 60))
    line = places[np.flatnonzero(states[:, 0] == SWEEP)[0] + 20]
    assert np.diff(np.sort(line[:, 0])) == pytest.approx([3.4 / 3] * 3, abs=0.03)


def test_nobody_touches(swept):
    for _, places in swept.values():
        apart = np.linalg.norm(places[:, :, None] - places[:, None], axis=-1) + 9 * np.eye(4)
        assert apart.min() > 2 * 0.085
