"""What sections answer for themselves, so that nobody else has to know their kinds."""

from math import hypot, sqrt

import pytest
from test_messages import HALL

from taichi_plume.assembly.preparation import load_scenario
from taichi_plume.scenario.domain import Domain
from taichi_plume.scenario.openings import MovingWall, Opening
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.scenario.wind_base import GUST

ROOM = Domain(size=(4.0, 3.0, 2.0), spacing=0.1)
REGION = {"center": (1.5, 1.0), "diameter": 0.5}
OPENINGS = {
    "blowing fan": {"kind": "fan", "face": "x-", "speed": 0.5, **REGION},
    "drawing fan": {"kind": "fan", "face": "x-", "speed": -0.7},
    "curved fan": {
        "kind": "fan",
        "face": "x-",
        "center": (1.0, 1.0),
        "size": (0.5, 0.5),
        "curve": {"pressure": 25, "flow": 0.5},
    },
    "inlet": {"kind": "inlet", "face": "y-", "speed": 1.0, "schedule": [{"at": 1, "speed": -3}]},
    "warm inlet": {"kind": "inlet", "face": "y-", "speed": 1.0, "temperature": 300},
    "straight inlet": {"kind": "honeycomb", "face": "y-", "speed": 0.2},
    "straight outlet": {"kind": "honeycomb", "face": "y-"},
    "outlet": {"kind": "outlet", "face": "z+"},
    "slip": {"kind": "slip", "face": "z+"},
    "wall": {"kind": "wall", "face": "z+", "velocity": (3.0, 4.0, 0.0)},
    "starting wall": {
        "kind": "wall", "face": "z+", "velocity": (0.0, 0.0, 0.0), "ramp": 2.0,
        "schedule": [{"at": 1, "velocity": (6.0, 8.0, 0.0)}],
    },
    "periodic": {"kind": "periodic", "axis": "y"},
}  # fmt: skip


def scenario(**changes) -> Scenario:
    gas = {"kind": "eulerian", "sources": [{"position": (1, 1, 1), "rate": 1e-6}]}
    data = {"duration": 10, "domain": ROOM, "wind": {"kind": "cfd"}, "gas": gas}
    return Scenario.model_validate(data | changes)


def opening(name: str) -> Opening:
    (one,) = scenario(wind={"kind": "cfd", "openings": [OPENINGS[name]]}).openings
    return one


@pytest.mark.parametrize(
    ("name", "blows", "lets_out", "warms", "speed", "label"),
    [
        ("blowing fan", True, False, False, 0.5, "fan 0.5 m/s"),
        ("drawing fan", True, False, False, 0.7, "fan -0.7 m/s"),
        ("curved fan", True, False, False, 2.0, "fan"),
        ("inlet", True, False, False, 3.0, "inlet 1 m/s"),
        ("warm inlet", True, False, True, 1.0, "inlet 1 m/s"),
        ("straight inlet", True, False, False, 0.2, "honeycomb 0.2 m/s"),
        ("straight outlet", False, True, False, 0.0, "honeycomb"),
        ("outlet", False, True, False, 0.0, "outlet"),
        ("slip", False, False, False, 0.0, "slip"),
        ("wall", False, False, False, 5.0, "wall"),
        ("starting wall", False, False, False, 10.0, "wall"),
        ("periodic", False, False, False, 0.0, "periodic"),
    ],
)
def test_openings(name, blows, lets_out, warms, speed, label):
    one = opening(name)
    assert (one.blows, one.lets_out, one.warms) == (blows, lets_out, warms)
    assert one.passes == (blows or lets_out)
    assert one.top_speed(ROOM) == pytest.approx(speed)
    assert one.label == label
    assert (one.region is None) == (name == "periodic") == (one.wraps == "y")
    assert all(0 <= part <= 255 for part in one.color)
    assert one.straight == name.startswith("straight")
    assert [step.speed for step in one.changes] == {"inlet": [-3], "starting wall": [10]}.get(name, [])


def test_walls_know_their_mean_velocity():
    wall = opening("starting wall")
    assert isinstance(wall, MovingWall)
    assert tuple(wall.mean_velocity(0.5, 0.9)) == (0.0, 0.0, 0.0)
    assert tuple(wall.mean_velocity(2.0, 2.0)) == (3.0, 4.0, 0.0)
    # half of the time at rest, half with a quarter of the speed on the mean
    assert wall.mean_velocity(0.0, 2.0) == pytest.approx((0.75, 1.0, 0.0))
    sudden = wall.model_copy(update={"ramp": 0.0})
    assert sudden.mean_velocity(0.0, 4.0) == pytest.approx((4.5, 6.0, 0.0))


def test_flow_in_and_out():
    assert opening("blowing fan").inflow(0.0, ROOM) == pytest.approx(0.5 * 3.14159265 / 16)
    assert opening("drawing fan").inflow(0.0, ROOM) == pytest.approx(-0.7 * 3 * 2)
    assert opening("inlet").inflow(0.0, ROOM) == pytest.approx(1.0 * 4 * 2)
    assert opening("inlet").inflow(2.0, ROOM) == pytest.approx(-3.0 * 4 * 2)
    assert opening("curved fan").follows_pressure
    assert all(opening(name).inflow(0.0, ROOM) == 0.0 for name in ("outlet", "slip", "wall", "periodic"))


@pytest.mark.parametrize(
    ("wind", "more", "top", "axes"),
    [
        ({"kind": "uniform", "velocity": (3, 4, 0)}, {}, 5.0, 7.0),
        ({"kind": "synthetic", "speed": 3, "circulation": 4}, {}, 10.0, 5.0 * GUST),
        ({"kind": "cfd"}, {}, 0.0, 0.0),
        ({"kind": "cfd", "openings": [OPENINGS["wall"], OPENINGS["inlet"]]}, {}, 5.0, 5.0 * GUST),
        ({"kind": "frozen", "openings": [OPENINGS["wall"]]}, {}, 5.0, 5.0 * GUST),
        (
            {"kind": "cfd", "openings": [OPENINGS["inlet"]]},
            {
                "obstacles": [
                    {"kind": "sphere", "center": (1, 1, 1), "radius": 0.1, "motion": {"path": [(0.5, 3, 1)]}}
                ]
            },
            4.0,
            4.0 * GUST,
        ),
        (
            {
                "kind": "cfd",
                "buoyancy": {"heat": {"reference": 300, "walls": [{"face": "z-", "temperature": 310}]}},
            },
            {},
            sqrt(9.81 / 300 * 10 * 4),
            sqrt(9.81 / 300 * 10 * 4) * GUST,
        ),
        ({"kind": "playback", "file": "fields.zarr"}, {}, None, 0.0),
    ],
)
def test_winds_know_their_largest_speed(wind, more, top, axes):
    one = scenario(wind=wind, **more)
    assert one.wind.top_speed(one) == (None if top is None else pytest.approx(top))
    assert one.wind.axes_speed(one) == pytest.approx(axes)
    courant = one.wind.computed.courant if one.wind.computed else 1.0
    assert one.wind.longest_step(one) == (pytest.approx(courant * 0.1 / axes) if axes else float("inf"))


def test_only_a_frozen_wind_stops():
    frozen = scenario(wind={"kind": "frozen", "after": 4}).wind
    assert (frozen.moving(10.0), frozen.moving(3.0)) == (4.0, 3.0)
    assert scenario().wind.moving(10.0) == 10.0


def test_obstacles_say_whether_they_move():
    walk = {"kind": "cylinder", "center": (1, 1), "radius": 0.2, "motion": {"path": [(2, 3, 1)]}}
    prism = {"kind": "prism", "vertices": [(0, 0), (1, 0), (0, 1)]}
    mesh = {"kind": "mesh", "file": "a.stl"}
    standing = {"kind": "box", "center": (1, 1, 1), "size": (1, 1, 1)}
    motions = [one.motion for one in scenario(obstacles=[walk, prism, mesh, standing]).obstacles]
    assert [motion is not None for motion in motions] == [True, False, False, False]
    assert motions[0].legs((1, 1)) == [(0.0, 2, pytest.approx(hypot(2, 0) / 2))]


SOURCE = {"position": (1, 1, 1), "rate": 1e-6}
PULSES = {"pulse": 1.0, "pause": 2.0}
STEADY = {"kind": "uniform", "velocity": (1, 0, 0)}
PUFFS = {"kind": "puffs", "sources": [SOURCE]}
STREWN = {"kind": "plumesim_meandering", "release_point": (1, 1)}


@pytest.mark.parametrize(
    ("changes", "drawn"),
    [
        ({}, False),
        ({"wind": STEADY}, False),
        ({"wind": STEADY | {"gusts": {}}}, True),
        ({"wind": STEADY | {"gusts": {"intensity": 0}}}, False),
        ({"wind": {"kind": "synthetic"}}, True),
        ({"wind": {"kind": "cfd", "openings": [OPENINGS["inlet"]]}}, False),
        ({"wind": {"kind": "cfd", "openings": [OPENINGS["inlet"] | {"turbulence_intensity": 0.1}]}}, True),
        ({"wind": {"kind": "playback", "file": "a.zarr"}}, False),
        ({"gas": {"kind": "eulerian", "sources": [SOURCE, SOURCE | {"puffing": PULSES}]}}, True),
        ({"gas": {"kind": "eulerian", "sources": [SOURCE | {"puffing": PULSES | {"spread": 0}}]}}, False),
        ({"gas": PUFFS}, True),
        ({"gas": {"kind": "mixture", "parts": [{"kind": "eulerian", "sources": [SOURCE]}]}}, False),
        ({"gas": {"kind": "mixture", "parts": [{"kind": "eulerian", "sources": [SOURCE]}, PUFFS]}}, True),
        ({"gas": STREWN}, True),
    ],
)
def test_whether_another_seed_makes_other_air(changes, drawn):
    assert scenario(**changes).air_by_chance == drawn


def test_gas_that_comes_in_is_that_of_its_schedule_and_units_of_sections_are_si(tmp_path):
    path = tmp_path / "s.yaml"
    path.write_text(HALL)
    changes = [
        "gas.inflow=[{opening: 0, concentration: 2 percent, schedule: [{at: 2 min, concentration: 7 ppm}]}]",
        "gas.surfaces.walls=[{face: z-, uptake: 1 mm/s}]",
        "gas.surfaces.obstacles=[{number: 0, uptake: 2 mm/s, transfer: 3 mm/s}]",
        "obstacles=[{kind: sphere, center: [2, 1.5, 1], radius: 0.3}]",
    ]
    gas = load_scenario(path, changes).gas
    assert [gas.inflow[0].at(t) for t in (-5.0, 119.0, 120.0)] == [20_000.0, 20_000.0, 7.0]
    assert gas.surfaces.walls[0].uptake == pytest.approx(1e-3)
    assert gas.surfaces.obstacles[0].transfer == pytest.approx(3e-3)
    growth = "gas.growth={kind: inertial, dissipation: 10 cm^2/s^3}"
    puffs = load_scenario(path, ["gas.kind=puffs", growth, "gas.fluctuation=3 cm/s", "gas.buoyancy=true"]).gas
    assert (puffs.growth.dissipation, puffs.fluctuation) == (pytest.approx(1e-3), pytest.approx(0.03))
