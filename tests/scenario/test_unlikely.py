"""A newcomer's mistakes, of which no section is wrong by itself, are told in a line; what ships gets none."""

from pathlib import Path

import numpy as np
import pytest
from test_remarks import remarks

from taichi_plume.assembly.prepare import load
from taichi_plume.scenario.context import Context
from taichi_plume.scenario.unlikely import course, peak

CONFIGS = sorted((Path(__file__).parents[2] / "configs").glob("*.yaml"))
ROOM = """\
duration: 60
warm_up: 10
domain: {size: [4, 3], spacing: 0.05, depth: 0.5}
wind:
  kind: cfd
  openings:
    - {kind: inlet, face: x-, speed: 0.5}
    - {kind: outlet, face: x+}
gas: {kind: eulerian, species: acetone, sources: [{position: [1, 1.5], rate: 10 mg/s}]}
robots:
  - {count: 2, start: {kind: positions, positions: [[3.5, 1], [3.5, 2]]}, algorithm: {kind: casting}}
"""
FAN = "wind.openings.0={kind: fan, face: x-, center: [1.5], diameter: 0.4, speed: 0.5}"
HEATED = "wind.buoyancy={gravity: [0, -9.81], heat: {heaters: [{position: [2, 1], power: 20"
UNIFORM = "wind={kind: uniform, velocity: [0.5, 0]}"


@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: path.stem)
def test_what_ships_gets_no_remark(path):
    assert load(path).resources.remarks == []


@pytest.mark.parametrize(
    "overrides",
    [
        (),
        (FAN,),
        (UNIFORM,),
        ("robots.0.start={kind: area, low: [3, 0.3], high: [3.8, 2.7]}",),
        ("wind.openings.0.speed=0.06", "duration=120"),
        ("robots.0.algorithm={kind: sweep}", "robots.0.start.positions=[[0.5, 1], [0.5, 2]]"),
        ("wind={kind: cfd, openings: [{kind: wall, face: y+, velocity: [0.3, 0]}]}",),
        ("wind={kind: cfd, buoyancy: {gravity: [0, -9.81]}}",),
        ("robots.0.sensors={gas: {kind: pid}}", "robots.0.algorithm.threshold_ppm=0.5"),
        ("gas.sources.0.position=[3.7, 1.5]",),
        (f"{HEATED}, radius: 0.075}}]}}}}",),
    ],
)
def test_what_is_meant_gets_none(tmp_path, overrides):
    assert remarks(tmp_path, ROOM, *overrides) == []


@pytest.mark.parametrize(
    ("overrides", "begins", "has"),
    [
        (["wind={kind: cfd}"], "wind: nothing moves the air", "kind: synthetic"),
        (
            ["obstacles=[{kind: cylinder, center: [3, 0.5], radius: 0.05}]"],
            "obstacles[0]: the obstacle is 0.1 m wide, 2 cells",
            "domain.spacing of 0.013 m or less",
        ),
        (["domain.spacing=0.7"], "domain.spacing: makes only 4 cells along y", "use 0.28 m or less"),
        (["duration=6", "warm_up=1", "robots=[]"], "duration: with the warm-up it is 7 s", "at least 8 s"),
        (
            ["wind.kind=frozen", "wind.after=5", "robots=[]"],
            "wind.after: 5 s is less than the 8 s or more",
            "kept before",
        ),
        (
            ["wind.openings.0={kind: fan, face: x-, center: [1.5], diameter: 0.1, speed: 0.5}"],
            "wind.openings[0]: is 0.1 m wide, 2 cells, too few",
            "0.017 m or less",
        ),
        (
            [f"{HEATED}, radius: 0.07}}]}}}}"],
            "wind.buoyancy.heat.heaters[0].radius: the heater is 0.14 m wide, 2.8 cells",
            "0.047 m or less",
        ),
        (["gas.sources.0.radius=0.01"], "gas.sources[0].radius: 0.01 m is less than half a cell", "lower"),
        (
            ["gas.sources.0.position=[3.9, 1.5]"],
            "gas.sources[0].position: is 0.1 m from where the air",
            "upwind",
        ),
        ([UNIFORM, "gas.sources.0.position=[3.9, 1.5]"], "gas.sources[0].position: is 0.1 m from", "upwind"),
        (
            [FAN, "gas.sources.0.position=[0.5, 2.8]"],
            "gas.sources[0].position: lies beside the jets",
            "in front",
        ),
        (["gas.sources.0.rate=100 g/s"], "gas.sources[0].rate: makes about 1.", "is its unit right"),
        (
            ["recording.range_ppm=[200000, 300000]", "robots=[]"],
            "recording.range_ppm: begins at 200000",
            "no plume",
        ),
        (["recording.range_ppm=[50, 1000]"], "recording.range_ppm: begins at 50 ppm", "from 5 ppm on"),
        (["robots.0.reach=0.01"], "robots[0].reach: 0.01 m is less than the 0.02 m", "lower tick"),
        (
            ["robots.0.algorithm={kind: ecoli, acquisition: 80}"],
            "robots[0].algorithm.acquisition: 80 s and 1 s to settle",
            "stand still",
        ),
        (
            [
                "wind={kind: synthetic, speed: 1 cm/s, circulation: 0}",
                "robots.0.sensors={wind: {kind: thermal}}",
            ],
            "robots[0].sensors.wind: sees no wind below 0.05 m/s",
            "casting will not know where upwind is",
        ),
        (
            ["robots.0.sensors={gas: {kind: pid}}", "robots.0.algorithm.threshold_ppm=0.08"],
            "robots[0].algorithm.threshold_ppm: 0.08 ppm is below what the sensor tells",
            "detection_limit_ppm: 0.1 ppm",
        ),
        (
            ["robots.0.sensors={gas: {kind: ideal, noise_ppm: 3}}"],
            "robots[0].algorithm.threshold_ppm: 5 ppm is crossed by the sensor's noise alone, 3 ppm",
            "above 9 ppm",
        ),
        (
            ["robots.0.algorithm.threshold_ppm=0.02"],
            "robots[0].algorithm.threshold_ppm: 0.02 ppm is crossed by the sensor's noise alone, 0.0075 ppm",
            "above 0.022 ppm",
        ),
        (
            [UNIFORM, "robots.0.algorithm.threshold_ppm=4000"],
            "robots[0].algorithm.threshold_ppm: 4000 ppm is more than the sensor reads at the source itself",
            "raise the source's rate",
        ),
        (
            ["arena={low: [2, 0], high: [4, 3]}"],
            "robots[0].reach: no source is within 0.35 m of where robots may go",
            "1 m outside of the arena",
        ),
        (
            ["robots.0.body={max_speed: 0.02}"],
            "robots[0]: start 2.2 m or more from where a source counts as found",
            "at most 1.2 m",
        ),
        (
            ["robots.0.start={kind: area, low: [3, 0.3], high: [3.8, 2.7]}", "robots.0.algorithm.speed=0.01"],
            "robots[0]: start 1.65 m or more",
            "at most 0.6 m",
        ),
        (
            ["robots.0.start.positions=[[0.4, 1], [0.4, 2]]"],
            "robots[0].start: all robots start upwind of every source",
            "start them downwind",
        ),
        (
            ["robots.0.start={kind: area, low: [0.2, 0.3], high: [0.5, 2.7]}"],
            "robots[0].start: all robots start upwind of every source",
            "start them downwind",
        ),
    ],
)
def test_a_mistake_is_told(tmp_path, overrides, begins, has):
    lines = remarks(tmp_path, ROOM, *overrides)
    assert [line for line in lines if line.startswith(begins) and has in line], lines
    assert len(lines) <= 3, lines  # what follows from it is told as well


def context(tmp_path, *overrides) -> Context:
    (tmp_path / "s.yaml").write_text(ROOM)
    return Context(*load(tmp_path / "s.yaml", overrides))


def test_the_course_of_the_air(tmp_path):
    def along(*overrides):
        found = course(context(tmp_path, *overrides))
        return found and (found.along.tolist(), found.speed)

    assert along() == ([1.0, 0.0], 0.5)
    assert along("wind.openings.0.speed=-0.5") == ([-1.0, 0.0], 0.5)
    assert along("wind.openings.1={kind: outlet, face: y+}") is None
    assert along("wind.openings.0.schedule=[{at: 5, speed: 1}]") is None
    assert along("wind={kind: synthetic}") is None
    assert along("wind={kind: uniform, velocity: [0, -0.3]}") == ([0.0, -1.0], 0.3)


def test_the_peak_of_a_plume_is_that_of_the_formula(tmp_path):
    """Of a Gaussian plume at its source, Q/(U sqrt(2 pi) s h) in a slab of depth h, as ppm of an ideal gas."""
    its = context(
        tmp_path,
        UNIFORM,
        "gas={kind: gaussian_plume, species: acetone, intensity: 0.1, sources: [{position: [1, 1.5], rate: 10 mg/s}]}",
    )
    (_, gas), (_, source) = its.scenario.gases[0], its.scenario.sources[0]
    density = 1e-5 / (0.5 * np.sqrt(2 * np.pi) * 0.05 * 0.5)
    assert peak(gas, source, its) == pytest.approx(
        density / 0.05808 * 8.314462618 * 298.15 / 101325 * 1e6, rel=1e-6
    )


def test_hardly_any_air_is_no_fault(tmp_path):
    """A speed that vanishes in a product: there was a division by zero."""
    assert remarks(tmp_path, ROOM, "wind.openings.0.speed=5e-324 m/s")
