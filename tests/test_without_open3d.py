"""open3d, the largest of what we depend on, is needed by meshes alone."""

import pytest
from scripts import python
from test_meshes import box_triangles, write_stl

WITHOUT = """
import sys
from importlib.abc import MetaPathFinder

class Missing(MetaPathFinder):
    def find_spec(self, name, path, target=None):
        if name.partition(".")[0] in ("open3d", "libusb_package"):
            raise ImportError(f"No module named '{name}'")

sys.meta_path.insert(0, Missing())
from taichi_plume.__main__ import main
for line in sys.argv[1].split(";"):
    code = main(line.split())
    if code:
        sys.exit(code)
"""
SCENARIO = """
duration: 0.5
domain: {size: [1, 1, 0.4], spacing: 0.1}
wind: {kind: cfd, openings: [{kind: inlet, face: x-, speed: 0.5}, {kind: outlet, face: x+}]}
obstacles: [OBSTACLE]
gas: {kind: eulerian, sources: [{position: [0.3, 0.5, 0.1], rate: 1 mg/s}]}
robots: [{count: 1, start: {kind: positions, positions: [[0.8, 0.8]]}, algorithm: {kind: casting}}]
maps: [{kind: time_series, window: 0.2}]
fields: {rate: 4}
"""


COMMANDS = """
run s.yaml --check
run s.yaml --quiet --no-recording --out a
run s.yaml --quiet --out b
report b
picture b --at 0.4 --out x.png
export a --to vtkhdf
export a --to netcdf
export a --to csv
maps a/robots.parquet --map gmrf --size 1 1 --out m
repair a
scenario --schema
validation --list
"""


@pytest.mark.slow
def test_all_commands_work_without_it(tmp_path):
    obstacle = "{kind: cylinder, center: [0.5, 0.5], radius: 0.1}"
    (tmp_path / "s.yaml").write_text(SCENARIO.replace("OBSTACLE", obstacle))
    done = python(tmp_path, "-c", WITHOUT, COMMANDS.strip().replace("\n", ";"))
    assert done.returncode == 0, done.stderr
    files = "b/recording.rrd b/report.html x.png a/fields.vtkhdf a/fields.nc a/robots.csv m/map.csv"
    for name in files.split():
        assert (tmp_path / name).stat().st_size > 0, name


def test_a_mesh_without_it_is_reported_in_a_line(tmp_path):
    write_stl(tmp_path / "box.stl", box_triangles([0.4, 0.4, 0], [0.6, 0.6, 0.2]))
    (tmp_path / "s.yaml").write_text(SCENARIO.replace("OBSTACLE", "{kind: mesh, file: box.stl}"))
    done = python(tmp_path, "-c", WITHOUT, "run s.yaml --check")
    assert done.returncode == 2
    (line,) = [line for line in done.stderr.splitlines() if "open3d" in line]
    assert "obstacles[0]" in line
    assert "pip install open3d" in line
    assert "Traceback" not in done.stderr
