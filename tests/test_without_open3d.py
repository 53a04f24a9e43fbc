"""open3d, the largest of what we depend on, is needed by meshes alone."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from test_meshes import box_triangles, write_stl

ROOT = Path(__file__).parent.parent
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


def without(folder: Path, *lines: str) -> subprocess.CompletedProcess[str]:
    """Commands run one after the other where there is no open3d."""
    return subprocess.run(
        [sys.executable, "-c", WITHOUT, ";".join(lines)],
        capture_output=True,
        text=True,
        check=False,
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
    )


@pytest.mark.slow
def test_all_commands_work_without_it(tmp_path):
    (tmp_path / "s.yaml").write_text(
        SCENARIO.replace("OBSTACLE", "{kind: cylinder, center: [0.5, 0.5], radius: 0.1}")
    )
    done = without(
        tmp_path,
        "run s.yaml --check",
        "run s.yaml --quiet --no-recording --out a",
        "run s.yaml --quiet --out b",
        "picture a --at 0.4 --out x.png",
        "export a --to vtkhdf",
        "export a --to netcdf",
        "export a --to csv",
        "maps a/robots.parquet --kind gmrf --size 1 1 --out m",
        "repair a",
        "scenario --schema",
        "validation --list",
    )
    assert done.returncode == 0, done.stderr
    for name in (
        "b/recording.rrd",
        "x.png",
        "a/fields.vtkhdf",
        "a/fields.nc",
        "a/robots.csv",
        "m/map.csv",
    ):
        assert (tmp_path / name).stat().st_size > 0, name


def test_a_mesh_without_it_is_told_in_a_line(tmp_path):
    write_stl(tmp_path / "box.stl", box_triangles([0.4, 0.4, 0], [0.6, 0.6, 0.2]))
    (tmp_path / "s.yaml").write_text(SCENARIO.replace("OBSTACLE", "{kind: mesh, file: box.stl}"))
    done = without(tmp_path, "run s.yaml --check")
    assert done.returncode == 2
    (line,) = [line for line in done.stderr.splitlines() if "open3d" in line]
    assert "obstacles[0]" in line
    assert "pip install open3d" in line
    assert "Traceback" not in done.stderr
