"""Formats of imported wind: what is read of them, and the line that tells what is wrong."""

import numpy as np
import pytest
from refusals import refused

from taichi_plume.files import gaden as occupancy
from taichi_plume.files.wind_points import WindFileError, find, read

PLACE = np.array([[0.5, 0.5, 0.25], [1.5, 0.5, 0.25], [0.5, 1.5, 0.25], [1.5, 1.5, 0.25]] * 2)
PLACE[4:, 2] = 0.75
SPEED = np.arange(24).reshape(8, 3) * [0.1, -0.01, 1e-3]


def table(header: str, columns: list[np.ndarray], mark: str = ",") -> str:
    return "\n".join([header, *(mark.join(f"{v:.9g}" for v in row) for row in np.column_stack(columns))])


@pytest.mark.parametrize(
    "text",
    [
        table('"U:0","U:1","U:2","Points:0","Points:1","Points:2"', [SPEED, PLACE]),
        table("Points_2,Points_0,p,U_1,U_0,U_2,Points_1", [PLACE[:, [2, 0]], SPEED[:, [0, 1, 0, 2]], PLACE[:, 1]]),
        table("x,y,z,u,v,w", [PLACE, SPEED]),
        table("X [ m ], Y [ m ], Z [ m ], Velocity u [ m s^-1 ]", [PLACE, SPEED]).replace(
            "Velocity u [ m s^-1 ]", "U (m/s); V (m/s); W (m/s)").replace(";", ","),
        table("nodenumber, x-coordinate, y-coordinate, z-coordinate, x-velocity, y-velocity, z-velocity",
              [np.arange(8), PLACE, SPEED]),
        table("# x y z Ux Uy Uz", [PLACE, SPEED], "  "),
        table("# a set of samples\n#\n#  x   y   z   U_x   U_y   U_z", [PLACE, SPEED], "\t"),
        table("", [PLACE, SPEED], " "),
        table("\ufeffx;y;z;u;v;w", [PLACE, SPEED], ";") + "\n\n",
    ],
)  # fmt: skip
def test_columns_are_found_by_their_names(tmp_path, text):
    path = tmp_path / "wind.csv"
    path.write_text(text, encoding="utf-8")
    points = read(path)
    np.testing.assert_allclose(points.place, PLACE)
    np.testing.assert_allclose(points.velocity, SPEED, atol=1e-12)
    assert points.eddy_viscosity is None


def test_eddy_viscosity_and_files_of_two_dimensions(tmp_path):
    path = tmp_path / "wind.csv"
    flat = PLACE[:, :2] + PLACE[:, 2:]
    path.write_text(table("nut,x,y,u,v", [1e-3 * SPEED[:, 0], flat, SPEED[:, :2]]))
    points = read(path)
    assert points.place.shape == (8, 2)
    assert points.eddy_viscosity is not None
    np.testing.assert_allclose(points.eddy_viscosity, 1e-3 * SPEED[:, 0])


GOOD = table("x,y,z,u,v,w", [PLACE, SPEED])
LINES = GOOD.splitlines()


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("", "is empty"),
        (" \n\n", "is empty"),
        ("x,y,z,u,v,w\n", "has 0 points with a velocity, too few"),
        ("\n".join(LINES[:4]), "has 3 points with a velocity, too few"),
        (GOOD.replace("x,y,z,u,v,w", "x,y,z,u,v"), "its header names 5 columns (x, y, z, u, v), its rows have 6"),
        ("\n".join(line + ",1" for line in LINES[1:]), "has no column x, y, u, v; no line above its numbers names"),
        (GOOD.replace("z,u,v", "height,u,speed"), "has no column v; it has x, y, height, u, speed, w"),
        (GOOD.replace("z,u,v,w", "z,u,v,p"), "has no column w; it has one for x, y, z, u, v"),
        (GOOD[: GOOD.rindex(",")], "line 9: has 5 columns, not 6; is the file whole?"),
        (GOOD.replace("0.6", "0.6x"), "line 4: '0.6x' is no number"),
        (GOOD.replace("0.6", ""), "has 7 points with a velocity, too few"),
        (GOOD.replace("0.6", "nan"), "has 7 points with a velocity, too few"),
        (GOOD.replace("1.5,1.5,0.25", "nan,1.5,0.25"), "line 5: its position is no finite number"),
        (GOOD.replace("0.6", "1e30"), r"line 4: 1e\+30 m/s is too fast"),
        (GOOD.replace("1.5,1.5,0.25", "1e30,1.5,0.25"), r"line 5: 1e\+30 m is too far; at most 1e\+08 m"),
        (GOOD.replace(",0.6", ",(0.6 0 0)"), r"line 4: '\(0.6 0 0\)' is no number"),
    ],
)  # fmt: skip
def test_faults_name_file_and_line(tmp_path, text, fault):
    path = tmp_path / "wind.csv"
    path.write_text(text)
    with refused(WindFileError, path, f"wind.csv: {fault}"):
        read(path)


def test_numbered_and_timed_files(tmp_path):
    for n in (7, 8, 9, 10):
        (tmp_path / f"a_{n}.csv").touch()
    for t in ("0", "0.5", "2e1", "9"):
        (tmp_path / "set" / t).mkdir(parents=True)
        (tmp_path / "set" / t / "U.xy").touch()
    (tmp_path / "a_x.csv").touch()
    found = find(tmp_path, "a_%d.csv", 0.5)
    assert [(t, path.name) for t, path in found] == [
        (0.0, "a_7.csv"), (0.5, "a_8.csv"), (1.0, "a_9.csv"), (1.5, "a_10.csv")]  # fmt: skip
    assert [t for t, _ in find(tmp_path, "set/%g/U.xy", 1.0)] == [0.0, 0.5, 9.0, 20.0]
    assert find(tmp_path / "set", "../a_7.csv", 1.0)[0][1].exists()
    assert len(find(tmp_path / "set", str(tmp_path / "a_%d.csv"), 1.0)) == 4
    (tmp_path / "a_9.csv").unlink()
    for pattern, fault in [
        ("a_%d.csv", r"a_9\.csv: is missing, between a_8\.csv and a_10\.csv"),
        ("b_%d.csv", r"b_%d\.csv: there is no such file, whatever %d stands for"),
        ("b.csv", r"b\.csv: does not exist"),
        ("set", r"set: .*constant/polyMesh.*files of points"),
        ("%g/%d", "one of %d and %g"),
    ]:
        with pytest.raises(WindFileError, match=fault):
            find(tmp_path, pattern, 1.0)


GRID = """#env_min(m) -1 0 0.5
#env_max(m) 0.5 1 1.5
#num_cells 3 2 2
#cell_size(m) 0.5
1 1
0 1
2 0
;
0 0
0 0
1 0
;
"""


def test_occupancy_grid(tmp_path):
    (tmp_path / "occupancy.csv").write_text(GRID)
    grid = occupancy.read(tmp_path / "occupancy.csv")
    assert grid.size == 0.5
    np.testing.assert_array_equal(grid.low, [-1, 0, 0.5])
    np.testing.assert_array_equal(grid.cubes[:, :, 0], [[1, 1], [0, 1], [2, 0]])
    np.testing.assert_array_equal(grid.cubes[:, :, 1], [[0, 0], [0, 0], [1, 0]])


@pytest.mark.parametrize(
    ("old", "new", "fault"),
    [
        ("0 1\n", "0 1 1\n", "line 6: must be 2 numbers of 0, 1 and 2"),
        ("0 1\n", "0 3\n", "line 6: must be 2 numbers of 0, 1 and 2"),
        ("0 1\n", "", "has 5 rows and 2 semicolons, not 3 rows in each of 2 layers"),
        ("1 0\n;\n", "", "has 5 rows and 1 semicolons, not 3 rows in each of 2 layers as its num_cells 3 x 2 x 2 say"),
        ("3 2 2", "4 2 2", "4 x 2 x 2 cells of 0.5 m do not reach from env_min to env_max"),
        ("1.5\n#num_cells 3 2 2", "400000000.5\n#num_cells 3 2 800000000", "has 6 rows and 2 semicolons, not 3"),
        ("3 2 2", "3.5 2 2", "its header gives no cells"),
        ("3 2 2", "3 2", "line 3: wrong numbers after num_cells"),
        ("#cell_size(m) 0.5\n", "", "line 4: must be one of #env_min"),
        ("-1 0 0.5", "-1 0 nan", "line 1: wrong numbers after env_min"),
        (GRID, "", "is empty"),
    ],
)  # fmt: skip
def test_faults_of_an_occupancy_grid(tmp_path, old, new, fault):
    (tmp_path / "occupancy.csv").write_text(GRID.replace(old, new, 1))
    with pytest.raises(WindFileError, match=r"occupancy\.csv: " + fault):
        occupancy.read(tmp_path / "occupancy.csv")


@pytest.mark.parametrize("pattern", ["w_%d.csv", "w_%g.csv"])
def test_numbers_in_names_are_finite(tmp_path, pattern):
    for number in ("1", "9" * 200):
        (tmp_path / f"w_{number}.csv").touch()
    (tmp_path / "w_1e999.csv").touch()
    with pytest.raises(WindFileError, match="its number is above"):
        find(tmp_path, pattern, 1.0)
