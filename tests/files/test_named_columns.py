"""Tables of other programs: names, units, marks, times and missing values of their headers and cells."""

import numpy as np
import pandas
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from taichi_plume.files.readings import ReadingsError
from taichi_plume.files.readings import read as read_log
from taichi_plume.files.wind_points import WindFileError
from taichi_plume.files.wind_points import read as read_wind

RNG = np.random.default_rng(7)
PLACE = np.stack(np.meshgrid([0.1, 0.5, 0.9], [1.2, 1.7], [0.3, 0.4], indexing="ij"), -1).reshape(-1, 3)
SPEED = RNG.uniform(-1, 1, PLACE.shape).round(4)


def rows(*columns, mark=",", decimal="."):
    table = np.column_stack(columns)
    return "\n".join(mark.join(f"{v:.9g}".replace(".", decimal) for v in row) for row in table) + "\n"


@pytest.mark.parametrize(
    "text",
    [
        '"Velocity[i] (m/s)","Velocity[j] (m/s)","Velocity[k] (m/s)","X (m)","Y (m)","Z (m)"\n' + rows(SPEED, PLACE),
        "\n[Name]\nSection 3\n\n[Data]\nX [ m ], Y [ m ], Z [ m ], Velocity u [ cm s^-1 ], Velocity v [ cm s^-1 ], "
        "Velocity w [ cm s^-1 ]\n" + rows(PLACE, 100 * SPEED) + "\n[Faces]\n0, 1, 2\n",
        "% Model:       room.mph\n% Nodes:       12\n% Length unit: mm\n"
        "% x            y        z         u (m/s)     v (m/s)    w (m/s)\n" + rows(1e3 * PLACE, SPEED, mark="   "),
        '"Coordinates:0","Coordinates:1","Coordinates:2","p","U:0","U:1","U:2"\n' + rows(PLACE, PLACE[:, 0], SPEED),
        "x;y;z;vx;vy;vz\n" + rows(PLACE, SPEED, mark=";", decimal=","),
        "x [mm]\ty [mm]\tz [mm]\tu [mm/s]\tv [mm/s]\tw [mm/s]\n"
        + rows(1e3 * PLACE, 1e3 * SPEED, mark="\t", decimal=","),
        "X_mm,Y_mm,Z_mm,U,V,W\n" + rows(1e3 * PLACE, SPEED),
        "# x y z Ux Uy Uz\n" + rows(PLACE, SPEED, mark=" ", decimal=","),
        "cellnumber, x-coordinate, y-coordinate, z-coordinate, x-velocity, y-velocity, z-velocity\n"
        + rows(np.arange(12), PLACE, SPEED),
    ],
    ids=["starccm", "cfdpost", "comsol", "paraview", "semicolons", "tabs", "suffix", "raw", "fluent"],
)  # fmt: skip
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "latin-1"])
def test_winds_of_all_programs(tmp_path, text, encoding):
    path = tmp_path / "w.csv"
    path.write_text(text, encoding=encoding)
    points = read_wind(path)
    np.testing.assert_allclose(points.place, PLACE, rtol=1e-9)
    np.testing.assert_allclose(points.velocity, SPEED, rtol=1e-8)


UNITS = {
    "t": {"s": 1.0, "ms": 1e-3, "min": 60.0, "": 1.0},
    "x": {"m": 1.0, "mm": 1e-3, "cm": 1e-2, "": 1.0},
    "y": {"m": 1.0, "km": 1e3, "ft": 0.3048, "": 1.0},
    "reading": {"ppm": 1.0, "ppb": 1e-3, "%": 1e4, "ppmv": 1.0, "": 1.0},
    "wind_x": {"m/s": 1.0, "cm/s": 0.01, "km/h": 1 / 3.6, "m s-1": 1.0, "": 1.0},
    "wind_y": {"m/s": 1.0, "mm s^-1": 1e-3, "": 1.0},
}


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    units=st.fixed_dictionaries({key: st.sampled_from(sorted(known)) for key, known in UNITS.items()}),
    order=st.permutations(list(UNITS)),
    bracket=st.sampled_from(["{} ({})", "{} [{}]", "{}[ {} ]"]),
    style=st.sampled_from([(",", "."), (";", ","), (";", "."), ("\t", ",")]),
    named=st.booleans(),
    missing=st.sampled_from([-999, -9999.0, 65535]),
)
def test_logs_with_units_in_any_order(tmp_path_factory, units, order, bracket, style, named, missing):
    truth = {key: np.random.default_rng(2).uniform(1, 9, 6).round(3) for key in UNITS}
    truth["t"] = np.sort(truth["t"])
    factors = {key: UNITS[key][unit] for key, unit in units.items()}
    for silent, other in ("xy", "yx"):  # lengths without a unit are in that of the others
        if not units[silent]:
            factors[silent] = factors[other]
    stored = {key: truth[key] / factors[key] for key in UNITS}
    stored["reading"] = np.where(np.arange(6) == 2, missing, stored["reading"])
    names = {key: f"sensor {n}" if named else key for n, key in enumerate(UNITS)}
    header = [bracket.format(names[key], units[key]) if units[key] else names[key] for key in order]
    path = tmp_path_factory.mktemp("log") / "log.csv"
    text = (
        style[0].join(header) + "\n" + rows(*(stored[key] for key in order), mark=style[0], decimal=style[1])
    )
    path.write_text(text)
    log = read_log(path, columns=names if named else None, missing=[missing])
    np.testing.assert_allclose(log.t, truth["t"], rtol=1e-7)
    np.testing.assert_allclose(log.place, np.column_stack([truth["x"], truth["y"]]), rtol=1e-7)
    known = np.arange(6) != 2
    np.testing.assert_allclose(log.reading[known], truth["reading"][known], rtol=1e-7)
    assert np.isnan(log.reading[2])
    np.testing.assert_allclose(log.wind[:, 0], truth["wind_x"], rtol=1e-7)
    assert any(f"are {missing:g}" in remark for remark in log.facts.remarks)
    for key, unit in units.items():
        is_assumed = not unit and not (key in "xy" and (units["x"] or units["y"]))
        assert (f" {names[key]} in " in log.facts.text) == is_assumed


@pytest.mark.parametrize(
    ("cells", "seconds"),
    [
        (["2026-01-01T10:00:00", "2026-01-01T10:00:00.5"], [1767261600.0, 1767261600.5]),
        (["2026-01-01 11:00:00,25+01:00", "2026-01-02 00:00+00:00"], [1767261600.25, 1767312000.0]),
        (["10:00:01.5", "10:02:00"], [36001.5, 36120.0]),
    ],
)
def test_times_of_day_and_dates(tmp_path, cells, seconds):
    path = tmp_path / "log.csv"
    path.write_text("time;x;y;reading\n" + "".join(f"{cell};1;2;3\n" for cell in cells))
    np.testing.assert_allclose(read_log(path).t, seconds)


def test_dates_of_a_data_frame(tmp_path):
    times = pandas.to_datetime(["2026-01-01T10:00:00Z", "2026-01-01T10:00:02Z"])
    frame = pandas.DataFrame(
        {"time": times, "x (cm)": [100, 200], "y": [1.0, 2.0], "reading": [5.0, -9999.0]}
    )
    log = read_log(frame)
    np.testing.assert_allclose(log.t, [1767261600.0, 1767261602.0])
    np.testing.assert_allclose(log.place[:, 0], [1.0, 2.0])
    np.testing.assert_array_equal(log.reading, [5.0, np.nan])
    assert "1 of 2 values of reading are -9999, which counts as missing" in log.facts.remarks
    assert "2 s from 2026-01-01 10:00:00 UTC on" in log.facts.text


def test_columns_that_the_user_names(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("stamp,px,py,CO2,CO2 dry\n0,100,200,400,390\n1000,110,210,410,395\n")
    names = {"t": "stamp [ms]", "x": "px [cm]", "y": "py [cm]", "reading": "CO2 dry [ppb]"}
    log = read_log(path, columns=names)
    assert log.t.tolist() == [0.0, 1.0]
    np.testing.assert_allclose(log.place, [[1.0, 2.0], [1.1, 2.1]])
    np.testing.assert_allclose(log.reading, [0.39, 0.395])
    plain = tmp_path / "plain.txt"
    plain.write_text("0 1 2 7 3\n1 1 2 8 4\n")
    log = read_log(plain, columns={"t": "1", "x": "2", "y": "3", "reading": "5"})
    assert log.reading.tolist() == [3.0, 4.0]
    headed = tmp_path / "headed.csv"
    headed.write_text("t [ms],x_mm,y (cm),gas [ppb]\n0,100,200,400\n1000,110,210,410\n")
    log = read_log(headed, columns={"t": "1", "x": "2", "y": "3", "reading": "4"})
    assert (log.t[1], *log.place[1], log.reading[1]) == pytest.approx((1.0, 0.11, 2.1, 0.41))
    for wrong, reported in (
        ({"t": "time"}, "has no column 'time' for t; it has stamp, px, py, CO2, CO2 dry"),
        ({"speed": "px"}, "'speed' is none of date, t, x, y"),
        (names | {"x": "px [s]"}, "'s' is no unit that converts to m"),
    ):
        with pytest.raises(ReadingsError, match=reported.replace("(", r"\(")):
            read_log(path, columns=names | wrong if "t" in wrong else wrong)


def test_times_that_cannot_be_seconds_ask_for_their_unit(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("t,x,y,reading\n1767261600000,1,2,3\n1767261600500,1,2,3\n")
    with pytest.raises(ReadingsError, match=r"t of row 1 is 1\.76726e\+12, a mistake; .* t=stamp \[ms\]"):
        read_log(path)
    log = read_log(path, columns={"t": "t [ms]"})
    np.testing.assert_allclose(np.diff(log.t), 0.5)


def test_points_without_a_velocity_are_left_out(tmp_path):
    speed = SPEED.copy()
    speed[3] = -9999
    text = "x,y,z,u,v,w\n" + rows(PLACE, speed)
    lines = text.splitlines()
    lines[6] = ",".join([*lines[6].split(",")[:3], "", "", ""])
    path = tmp_path / "w.csv"
    path.write_text("\n".join(lines))
    points = read_wind(path)
    left = np.delete(np.arange(12), [3, 5])
    np.testing.assert_allclose(points.velocity, SPEED[left])
    assert "2 of 12 points have no velocity, and are left out" in points.remarks
    path.write_text(text.replace("0.1,", "-9999,"))
    with pytest.raises(WindFileError, match="line 2: its position is no finite number"):
        read_wind(path)
