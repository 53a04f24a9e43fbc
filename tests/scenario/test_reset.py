"""What a reset may change: numbers, seeds and outputs; all that something was built from must stay."""

from typing import Any, get_args

import pytest

from taichi_plume.scenario.key_facts import models_in
from taichi_plume.scenario.keys import places
from taichi_plume.scenario.loading import read_scenario
from taichi_plume.scenario.reset import differences, structure
from taichi_plume.scenario.vocabulary import COMPILED, FREE, Model, marked

ROOM = """\
duration: 10
domain: {size: [4, 3], spacing: 0.05, depth: 0.5}
wind:
  kind: cfd
  acceleration: [0, 0]
  openings:
    - {kind: fan, face: x-, center: [1.5], diameter: 0.4, speed: 0.5}
    - {kind: outlet, face: x+}
  screens: [{kind: honeycomb, axis: x, at: 1}]
obstacles: [{kind: box, center: [2, 1], size: [0.4, 0.3]}]
gas: {kind: eulerian, sources: [{position: [1, 1.5], rate: 1e-5}]}
robots:
  - count: 2
    start: {kind: positions, positions: [[1, 1], [1, 2]]}
    algorithm: {kind: own, parameters: {gain: 1.5, steps: 3}}
    sensors: {gas: {kind: pid, correction: {ethanol: 10.0}}}
maps: [{kind: time_series}]
"""


@pytest.fixture
def room(tmp_path):
    """The scenario with changes as of the command line."""
    path = tmp_path / "room.yaml"
    path.write_text(ROOM)
    return lambda *changes: read_scenario(path, changes)


@pytest.mark.parametrize(
    "change",
    [
        "seed=7",
        "name=other",
        "duration=99",
        "warm_up=3",
        "stop_early=false",
        "recording={rate: 1, volume: false}",
        "fields={rate: 1}",
        "plumesim_log={}",
        "wind.viscosity=2e-5",
        "wind.turbulence={kind: smagorinsky, constant: 0.1}",
        "wind.openings.0.speed=-0.2",
        "wind.screens.0.transverse=9",
        "wind.acceleration=[1, 0]",
        "gas.sources.0={position: [1.2, 1.4], rate: 2e-5, radius: 0.05}",
        "gas.species=ethanol",  # as before
        "robots.0.start.positions=[[1, 1.1], [1.5, 2]]",
        "robots.0.reach=0.2",
        "robots.0.algorithm.parameters={gain: 2.5, steps: 3}",
        "robots.0.sensors.gas.correction={ethanol: 9.0}",
    ],
)
def test_numbers_seeds_and_outputs_may_differ(room, change):
    assert differences(room(), room(change)) == []
    assert structure(room()) == structure(room(change))


@pytest.mark.parametrize(
    ("change", "line"),
    [
        ("wind={kind: uniform, velocity: [1, 0]}", "wind.kind: was cfd, is uniform"),
        ("wind.turbulence={kind: vreman}", "wind.turbulence.kind: was smagorinsky, is vreman"),
        ("wind.convection=weno5", "wind.convection: was upwind5, is weno5"),
        ("rivals=true", "rivals: was False, is True"),
        ("robots.0.first_trial=3", "robots[0].first_trial: was 0, is 3"),
        ("wind.openings.0.face=y-", "wind.openings[0].face: was x-, is y-"),
        (
            "wind.openings.0.turbulence_length=0.1",
            "wind.openings[0].turbulence_length: was not given, is 0.1",
        ),
        ("wind.acceleration=null", "wind.acceleration: was 2 items, is not given"),
        ("wind.buoyancy.gravity=[0, 1]", "wind.buoyancy: was not given, is given (Buoyancy)"),
        ("obstacles=[]", "obstacles: was 1 item, is 0 items"),
        ("domain.size=[4, 3, 1]", "domain.size: was 2 items, is 3 items"),
        ("domain.size=[4, 4]", "domain.size[1]: was 3, is 4"),
        ("domain.spacing=0.1", "domain.spacing: was 0.05, is 0.1"),
        ("domain.depth=1", "domain.depth: was 0.5, is 1"),
        ("maps.0.beta=0.6", "maps[0].beta: was 0.5, is 0.6"),
        ("tick=0.2", "tick: was 0.1, is 0.2"),
        ("obstacles.0.center=[2, 1.5]", "obstacles[0].center[1]: was 1, is 1.5"),
        ("wind.openings.0.center=[1.6]", "wind.openings[0].center[0]: was 1.5, is 1.6"),
        ("wind.openings.0.diameter=0.5", "wind.openings[0].diameter: was 0.4, is 0.5"),
        ("wind.screens.0.at=2", "wind.screens[0].at: was 1, is 2"),
        ("wind.screens.0.thickness=0.1", "wind.screens[0].thickness: was 0.05, is 0.1"),
        ("gas.species=acetone", "gas.species: was ethanol, is acetone"),
        (
            "gas.species={molar_mass: 0.05, diffusivity: 1e-5}",
            "gas.species: was ethanol, is given (OtherSpecies)",
        ),
        (
            "robots.0.algorithm.parameters={gain: 1.5, steps: 4}",
            "robots[0].algorithm.parameters.steps: was 3, is 4",
        ),
        (
            "robots.0.sensors.gas.correction={acetone: 1.0}",
            "robots[0].sensors.gas.correction: was of ethanol, is of acetone",
        ),
    ],
)
def test_what_something_was_built_from_must_stay(room, change, line):
    assert differences(room(), room(change)) == [line]
    assert structure(room()) != structure(room(change))


def test_names_with_dots_are_no_paths(room):
    flat, deep = "robots.0.algorithm.parameters={a.b: 1}", "robots.0.algorithm.parameters={a: {b: 1}}"
    both = "robots.0.algorithm.parameters={a.b: 1, a: {b: 2}}"
    (line,) = differences(room(flat), room(deep))
    assert line == "robots[0].algorithm.parameters: was of a.b, is of a"
    assert differences(room(both), room(both)) == []
    assert structure(room(both)) != structure(room(both.replace("2", "3")))


def test_every_difference_is_reported(room):
    changes = ("tick=0.2", "obstacles=[]", "robots.0.count=1", "seed=3")
    assert [line.partition(":")[0] for line in differences(room(), room(*changes))] == [
        "tick",
        "obstacles",
        "robots[0].count",
    ]


def test_a_mark_counts_for_all_below():
    class Inner(Model):
        number: float = 1.0
        name: str = "a"

    class Outer(Model):
        free: Inner = Inner()
        still: Inner = Inner()

    Outer.model_fields["free"].metadata.append(FREE)
    Outer.model_fields["still"].metadata.append(COMPILED)
    other = Inner(number=2.0, name="b")
    assert differences(Outer(), Outer(free=other, still=other)) == [
        "still.number: was 1, is 2",
        "still.name: was a, is b",
    ]


# ---------------------------------------------------------------- the whole vocabulary


def vocabulary() -> list[type[Model]]:
    """All sections, by their names."""
    return sorted(
        {model for place in places().values() for model in place.models}, key=lambda model: model.__name__
    )


def other_floats(kind: Any) -> tuple[Any, Any] | None:
    """Two values of a type that differ in their floats alone; None where it has none."""
    if kind is float:
        return 1.0, 2.0
    parts = [pair for pair in map(other_floats, get_args(kind)) if pair]
    return ((parts[0][0],), (parts[0][1],)) if parts and not list(models_in(kind)) else None


def test_every_float_may_change_unless_it_is_marked():
    fixed = set()
    for model in vocabulary():
        blank = dict.fromkeys(model.model_fields)
        for key, field in model.model_fields.items():
            pair = other_floats(field.annotation)
            if pair is not None and not marked(model, key, FREE):
                one, other = (model.model_construct(**blank | {key: value}) for value in pair)
                assert bool(differences(one, other)) == marked(model, key, COMPILED), (
                    f"{model.__name__}.{key}"
                )
                fixed |= {f"{model.__name__}.{key}"} if differences(one, other) else set()
    shapes = {"Domain.spacing", "Scenario.tick", "Fan.diameter", "Box.yaw_deg", "Mesh.scale", "Source.radius"}
    tables = {"Heater.radius", "LogProfile.roughness", "Policy.memory", "Sweep.lane", "TimeSeriesMap.beta"}
    assert shapes | tables <= fixed
    assert len(fixed) >= 114
