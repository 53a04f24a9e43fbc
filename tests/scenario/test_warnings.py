"""Notes on what can be run but is probably not meant: about meshes, and what they are computed from."""

import numpy as np
import pytest
from test_meshes import box_triangles, write_stl
from test_messages import DUCT, FLOOR, ROOM, said

from taichi_plume.assembly.preparation import load
from taichi_plume.scenario.combinations import course, peak
from taichi_plume.scenario.domain import Context


def of_obstacles(tmp_path, *overrides):
    """Notes on obstacles; those on openings that obstacles cover are left out."""
    return [line for line in said(tmp_path, ROOM, *HALL, *overrides) if line.startswith("note: obstacles")]


def table(path, scale=1.0, slab=0.2):
    """A table of 1.6 x 0.8 m on legs of 8 cm, under a slab of that thickness [m]."""
    legs = [box_triangles((x, y, 0), (x + 0.08, y + 0.08, 0.7)) for x in (0, 1.52) for y in (0, 0.72)]
    slab = box_triangles((0, 0, 0.7), (1.6, 0.8, 0.7 + slab))
    return write_stl(path, scale * np.concatenate([slab, *legs]))


HALL = (
    "domain={size: [6, 4, 2], spacing: 0.2}",
    "obstacles=[{kind: mesh, file: table.stl, translate: [2.21, 1.61, 0]}]",
    "robots=[]",
    "gas.sources.0.position=[1, 1.5, 0.1]",
)


def test_thin_legs_of_a_table_are_reported_and_where(tmp_path):
    table(tmp_path / "table.stl")
    (line,) = of_obstacles(tmp_path)
    assert line.startswith("note: obstacles[0]: the grid misses ")
    assert " % of it, about (" in line
    place = np.array(line.split("about (")[1].split(")")[0].split(", "), float)
    assert 0 < place[2] < 0.7
    assert said(tmp_path, ROOM, *HALL, "domain.spacing=0.05") == []


def test_a_mesh_in_another_unit_is_reported_with_the_scale(tmp_path):
    table(tmp_path / "table.stl", scale=1000.0)
    (line,) = said(tmp_path, ROOM, *HALL)
    assert line.startswith("obstacles[0]: is at x 2.21 to 1602 m, far larger than the domain, x 0 to 6 m")
    assert "millimetres, give scale: 0.001" in line
    assert not said(tmp_path, ROOM, *HALL, "domain.spacing=0.05", "obstacles.0.scale=0.001")
    table(tmp_path / "table.stl")
    line, *_ = of_obstacles(tmp_path, "obstacles.0.scale=0.001", "obstacles.0.translate=[2.22, 1.66, 0.01]")
    assert "the grid misses all of it" in line
    assert "in metres, not millimetres, give scale: 1; otherwise lower domain.spacing" in line


def test_own_algorithms_may_declare(tmp_path):
    (tmp_path / "own.py").write_text("class Own:\n    def act(self, robots):\n        pass\n")
    own = "robots.0.algorithm={kind: own, file: own.py}"
    assert said(tmp_path, FLOOR, "robots.0.found=declared", own) == []


def context(tmp_path, *overrides) -> Context:
    (tmp_path / "s.yaml").write_text(DUCT)
    return load(tmp_path / "s.yaml", overrides).resources.context


@pytest.mark.parametrize(
    ("overrides", "along", "speed"),
    [
        ([], [1.0, 0.0], 0.5),
        (["wind.openings.0.speed=-0.5"], [-1.0, 0.0], 0.5),
        (["wind={kind: uniform, velocity: [0, -0.3]}"], [0.0, -1.0], 0.3),
        (["wind.openings.1={kind: outlet, face: y+}"], None, None),
        (["wind.openings.0.schedule=[{at: 5, speed: 1}]"], None, None),
        (["wind={kind: synthetic}"], None, None),
    ],
)
def test_the_course_of_the_air(tmp_path, overrides, along, speed):
    found = course(context(tmp_path, *overrides))
    assert (found and (found.along.tolist(), found.speed)) == (along and (along, speed))


def test_the_peak_of_a_plume_is_that_of_the_formula(tmp_path):
    """Of a Gaussian plume at its source, Q/(U sqrt(2 pi) s h) in a slab of depth h, as ppm of an ideal gas."""
    its = context(
        tmp_path,
        "wind={kind: uniform, velocity: [0.5, 0]}",
        "gas={kind: gaussian_plume, species: acetone, intensity: 0.1, sources: [{position: [1, 1.5], rate: 10 mg/s}]}",
    )
    (_, gas), (_, source) = its.scenario.gases[0], its.scenario.sources[0]
    density = 1e-5 / (0.5 * np.sqrt(2 * np.pi) * 0.05 * 0.5)
    ppm = density / 0.05808 * 8.314462618 * 298.15 / 101325 * 1e6
    assert peak(gas, source, its) == pytest.approx(ppm, rel=1e-6)
