"""Poses from a camera: frames, noise and delay against closed forms; robots that live with old poses."""

import numpy as np
import pytest
from arena import Run, Script
from numpy.testing import assert_array_equal
from robots import Driver
from test_odometry import SIZE, group, swarm_of

from taichi_plume.grid.state import State
from taichi_plume.scenario.localization import Camera, Odometry
from taichi_plume.scenario.search_algorithm import Spiral

pytestmark = pytest.mark.usefixtures("taichi")

MANY = 2000  # robots: a variance is estimated to sqrt(2/MANY) = 3.2 % of it
TOLERANCE = 5 * np.sqrt(2 / MANY)
ROUNDING = 40 * 1e-6  # m and rad in 40 steps: half of the last bit of a place, 15 m from the origin
EXACT = {"position_noise": 0.0, "heading_noise_deg": 0.0}


def camera(**keys):
    return Camera(kind="camera", **keys)


def driver(*groups, heading=0.0):
    return Driver(swarm_of(*groups, heading=heading))


def ahead(driver, steps, tick, speed=1.0, turn_rate=0.0):
    """x and heading (robots, steps) that the robots believe in at the end of each step, from x = 0 on."""
    driver.command(speed, turn_rate)
    poses = []
    for _ in range(steps):
        now = driver.move(1, tick)
        poses.append((now["believed_position"][:, 0] - SIZE / 2, now["believed_heading"]))
    return np.moveaxis(np.array(poses, float), 0, -1).swapaxes(0, 1)


def frames(t, rate, delay):
    """Times at which the frames were exposed that robots have at the times t; 0 before the first."""
    return np.maximum(np.floor((t - delay) * rate + 1e-9), 0) / rate


@pytest.mark.parametrize(
    ("tick", "rate", "delay"),
    [(0.1, 10, 0.0), (0.1, 10, 0.3), (0.1, 4, 0.0), (0.1, 25, 0.13), (0.25, 3, 0.7), (0.02, 5, 0.1)],
)
def test_poses_are_old_by_the_delay_and_hold_between_frames(tick, rate, delay):
    """On a straight drive and on a turn: v and w times the age of the last frame that has arrived."""
    one = driver(group(camera(rate=rate, delay=delay, **EXACT)))
    t = tick * np.arange(1, 41)
    ((x, _),) = ahead(one, 40, tick)
    assert x == pytest.approx(frames(t, rate, delay), abs=ROUNDING)
    one = driver(group(camera(rate=rate, delay=delay, **EXACT)))
    ((_, heading),) = ahead(one, 40, tick, 0.0, -1.5)
    off = heading + 1.5 * frames(t, rate, delay)
    assert np.angle(np.exp(1j * off)) == pytest.approx(np.zeros(40), abs=ROUNDING)


def test_frames_do_not_drift_in_an_hour():
    one = driver(group(camera(rate=10, delay=0.1, **EXACT)))
    one.tick = 36_000
    ((x, _),) = ahead(one, 5, 0.1)
    assert x[1:] == pytest.approx(0.1 * np.arange(1, 5), abs=1e-5)


def test_noise_of_a_frame():
    """Normal, without bias, independent in x, y, heading, frames and robots; it holds with the pose."""
    one = driver(group(camera(position_noise=0.02, heading_noise_deg=3.0, rate=5, delay=0.0), MANY))
    off = []
    for _ in range(4):
        now = one.move(1, 0.1)
        off.append(np.column_stack([now["believed_position"] - now["position"], now["believed_heading"]]))
    first, second = off[1], off[3]
    assert not off[0].any()  # before the first frame
    assert_array_equal(off[2], first)
    errors = np.column_stack([first, second]) / np.tile([0.02, 0.02, np.radians(3.0)], 2)
    assert np.cov(errors.T) == pytest.approx(np.eye(6), abs=TOLERANCE)
    assert np.abs(errors.mean(axis=0)).max() < 5 / np.sqrt(MANY)
    assert np.mean(errors**4) == pytest.approx(3.0, rel=0.15)


def test_who_has_another_localisation_beside_it():
    """A camera changes no other group, nor the way; the wheels count the distance exactly."""
    kinds = (camera(), Odometry(kind="odometry"), None)
    names = ("seen", "wheels", "exact")
    mixed = driver(*(group(kind, 3, name=name) for kind, name in zip(kinds, names, strict=True)))
    plain = driver(*(group(None if n == 0 else kind, 3, name=names[n]) for n, kind in enumerate(kinds)))
    for one in (mixed, plain):
        one.command(0.7, 0.3)
        one.move(20)
    now, before = mixed.swarm.snapshot(), plain.swarm.snapshot()
    for name in ("position", "heading", "odometer"):
        assert_array_equal(now[name], before[name])
    for name in ("believed_position", "believed_heading"):
        assert_array_equal(now[name][3:], before[name][3:])
        assert (now[name][:3] != before[name][:3]).all()


def test_a_trial_alone():
    many = driver(group(camera(), 6, count=2), group(camera(), 6, name="others"))
    alone = driver(group(camera(), first_trial=4, count=2), group(camera(), first_trial=4, name="others"))
    off = []
    for one in (many, alone):
        now = one.move(10)
        off.append((now["believed_position"] - one.swarm.start, now["believed_heading"]))
    rows = [8, 9, 12 + 4]
    np.testing.assert_allclose(off[0][0][rows], off[1][0], atol=1e-5)
    assert_array_equal(off[0][1][rows], off[1][1])
    assert len(np.unique(off[0][1])) == 18


def test_it_goes_on_with_the_frames_that_are_under_way():
    run = Run({"kind": "random_walk"}, Script([0.0], 1.0), ((5, 5), (3, 4)), size=(10.0, 10.0),
              localization=camera(delay=0.55))  # fmt: skip
    run.go(3)
    state, tick, saved = State(run), run.tick, State(run).save()
    run.go(2)
    there = run.swarm.snapshot()
    run.go(5)
    state.restore(saved)
    run.tick = tick
    run.go(2)
    assert (there["believed_position"] != there["position"]).any()
    for name, values in run.swarm.snapshot().items():
        assert_array_equal(values, there[name], err_msg=name)


@pytest.mark.parametrize("delay", [0.1, 0.5])
def test_turns_do_not_overshoot_with_old_poses(delay):
    """Corners of a spiral to the left, 90 degrees each, turned by headings that are `delay` to `delay` + 0.1 s old."""
    model = Spiral(
        kind="spiral",
        arms=(0.1,) * 9,
        sense="left",
        settle=0.5,
        acquisition=1,
        minimum_ppm=100,
        strict_minimum=True,
    )
    seen = camera(delay=delay, rate=10, position_noise=0.0, heading_noise_deg=0.5)
    run = Run(model, Script([0.0], 1.0), ((5, 5),), 50, (10.0, 10.0), localization=seen)
    headings = []
    for _ in range(280):
        run.step()
        headings.append(run.swarm.heading.to_numpy())
    turned = np.unwrap(np.array(headings), axis=0)
    corners = run.swarm.acquisitions.to_numpy() - 1
    assert corners.min() >= 3
    assert (np.maximum.accumulate(turned, axis=0) - turned).max() < np.radians(3)
    last = turned[-1] - corners * np.pi / 2
    assert (last < np.pi / 2 + np.radians(3)).all()
    assert (last > -np.radians(3)).all()
