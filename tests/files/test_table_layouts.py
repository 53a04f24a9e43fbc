"""Layouts of tables that are read as they are, or refused by name: never by a shifted column or a lost unit."""

import numpy as np
import pandas
import pytest

from taichi_plume.files.readings import ReadingsError
from taichi_plume.files.readings import read as read_log
from taichi_plume.files.wind_points import WindFileError
from taichi_plume.files.wind_points import read as read_wind

PLACE = np.stack(np.meshgrid([0.25, 0.75, 1.25], [0.5, 1.5], indexing="ij"), -1).reshape(-1, 2)
SPEED = np.column_stack([0.1 + 0.1 * PLACE[:, 1], -0.02 * PLACE[:, 0]])


def rows(*columns, mark=","):
    return "\n".join(mark.join(f"{v:.9g}" for v in row) for row in np.column_stack(columns)) + "\n"


FLAT = rows(PLACE, SPEED)
BLANK = rows(PLACE, SPEED, mark="  ")


@pytest.mark.parametrize(
    "text",
    [
        "x,y,u,v\nmm,mm,cm/s,cm/s\n" + rows(1e3 * PLACE, 1e2 * SPEED),
        "[mm],[mm],[mm/s],[mm/s]\nx,y,u,v\n" + rows(1e3 * PLACE, 1e3 * SPEED),
        "% x  y  spf.u (m/s)  spf.v (m/s)\n" + BLANK,
        "% x                y               u (m/s) @ t=0.5    v (m/s) @ t=0.5\n" + BLANK,
        "% Model,room.mph\n% x,y,comp1.u (m/s),comp1.v (m/s)\n" + FLAT,
        "x y Static Pressure u v\n" + rows(PLACE, 1e5 + SPEED[:, 0], SPEED, mark=" ").replace(" ", "  "),
        "x (mm),y,u (meters per second),v (kn)\n" + rows(1e3 * PLACE, SPEED / [1.0, 1852 / 3600]),
        "X (MM),Y (MM),U (M/S),V (M/S)\n" + rows(1e3 * PLACE, SPEED),
        "x in mm,y in mm,u_cm_s,v_cm_s\n" + rows(1e3 * PLACE, 1e2 * SPEED),
        '"Mean of Velocity[i] (m/s)","Mean of Velocity[j] (m/s)","X (m)","Y (m)"\n' + rows(SPEED, PLACE),
        "X [ m ], Y [ m ], Velocity.Trnavg u [ m s^-1 ], Velocity.Trnavg v [ m s^-1 ]\n" + FLAT,
        "CellCenters:0,CellCenters:1,U:X,U:Y\n" + FLAT,
        "calibration,1.0,2.0,3.0\nx,y,u,v\n" + FLAT,
        "x,y,u,v\n" + FLAT.replace("0.25,", "2.5D-01,"),
        "x,y,u,v,\n" + FLAT,
        "x,y,u,v,p\n" + FLAT.replace("\n", ",-\n"),
        "[Data]\nx, y, u, v\n"
        + rows(PLACE[:2], SPEED[:2])
        + "\n[Data]\nx, y, u, v\n"
        + rows(PLACE[2:], SPEED[2:]),
        "Time,x,y,z,u,v,w\n" + rows(np.full(6, 2.0), PLACE, np.full(6, 0.4), SPEED, np.zeros(6)),
    ],
)
def test_layouts_of_winds(tmp_path, text):
    path = tmp_path / "w.csv"
    path.write_text(text)
    if "Static" in text:  # between single blanks the words of a header are no columns
        with pytest.raises(WindFileError, match=r"names 6 columns .*, its rows have 5"):
            read_wind(path)
        given = dict(zip("xyuv", "1245", strict=True))
        assert read_wind(path, given).velocity.shape == SPEED.shape
        return
    points = read_wind(path)
    np.testing.assert_allclose(points.place[:, :2], PLACE, rtol=1e-9)
    np.testing.assert_allclose(points.velocity[:, :2], SPEED, rtol=1e-7)


@pytest.mark.parametrize(
    ("text", "reported"),
    [
        ("x,y,u,v\n" + rows(np.arange(6), PLACE, SPEED), r"names 4 columns \(x, y, u, v\), its rows have 5"),
        (
            "% x y Velocity magnitude (m/s) u (m/s) v (m/s)\n" + rows(PLACE, SPEED[:, :1], SPEED, mark=" "),
            "names 6 col",
        ),
        (
            "time,x,y,u,v\n" + rows(np.repeat([0, 1], 6), np.tile(PLACE, (2, 1)), np.tile(SPEED, (2, 1))),
            "holds 2 times",
        ),
        ("x,y,u,v\n" + FLAT + rows(PLACE, 2 * SPEED), "its positions repeat"),
        ("x,y,u_rms_x,v,u\n" + rows(PLACE, SPEED[:, 0], SPEED[:, 1]), "names 5 columns|no column u|has 4"),
        ("x [counts],y,u,v\n" + FLAT, "'counts' is no unit that converts to m"),
        (
            "x (m),y (m),z (m),u (furlongs),v (m/s),w (m/s)\n" + rows(PLACE, SPEED, PLACE),
            "'furlongs' is no unit",
        ),
        (
            "[Data]\nx,y,u,v\n" + FLAT + "\n[Data]\nx,y,v,u\n" + FLAT,
            r"second section \[Data\] has other columns",
        ),
    ],
)
def test_layouts_that_are_refused(tmp_path, text, reported):
    path = tmp_path / "w.csv"
    path.write_text(text)
    with pytest.raises(WindFileError, match=reported):
        read_wind(path)


def test_points_that_paraview_marks_as_invalid_are_left_out(tmp_path):
    valid = np.array([1, 1, 0, 1, 1, 1])
    speed = np.where(valid[:, None] == 1, SPEED, 0.0)
    (tmp_path / "w.csv").write_text(
        "Points:0,Points:1,U:0,U:1,vtkValidPointMask\n" + rows(PLACE, speed, valid)
    )
    points = read_wind(tmp_path / "w.csv")
    np.testing.assert_allclose(points.velocity, SPEED[valid == 1], rtol=1e-7)
    assert "1 of 6 points have no velocity, and are left out" in points.remarks


LOG = [(0.0, 1.0, 2.0, 5.0), (1.0, 1.5, 2.5, 8.0), (2.0, 2.0, 3.0, 6.0)]


@pytest.mark.parametrize(
    ("text", "start"),
    [
        (
            "x\ty\treading\ttime\n1.0\t2.0\t5.0\t2026-01-01 10:00:05\n1.5\t2.5\t8\t2026-01-01 10:00:06\n",
            1767261605.0,
        ),
        ("date,time,x,y,reading\n2026-01-01,10:00:05,1,2,5\n2026-01-01,10:00:06,1.5,2.5,8\n", 1767261605.0),
        ("time,x,y,reading\n23:59:59.5,1,2,5\n00:00:00.5,1.5,2.5,8\n", 86399.5),
        (
            "time;x;y;reading\n2026-01-01 10:00:05 UTC;1;2;5\n2026-01-01 10:00:06 UTC;1.5;2.5;8\n",
            1767261605.0,
        ),
        ("t,x,y,reading,T [°C]\n3,1,2,5,20\n4,1.5,2.5,8,21\n", 3.0),
        ("t,x,y,reading\ns,cm,cm,ppb\n3,100,200,5000\n4,150,250,8000\n", 3.0),
    ],
)
def test_times_and_units_of_logs(tmp_path, text, start):
    path = tmp_path / "log.csv"
    path.write_text(text)
    log = read_log(path)
    np.testing.assert_allclose(log.t, [start, start + 1.0])
    np.testing.assert_allclose(log.place, [[1.0, 2.0], [1.5, 2.5]])
    np.testing.assert_allclose(log.reading, [5.0, 8.0])


@pytest.mark.parametrize(
    ("text", "reported"),
    [
        (
            "time,x,y,reading\n2026-01-01 10:00:00,123,2.0,1.0,5\n2026-01-01 10:00:01,123,2.0,1.0,5\n",
            "rows have 5",
        ),
        ("time [lightyears],x,y,reading\n0,1,2,5\n1,1,2,5\n", "'lightyears' is no unit that converts to s"),
        ("time,x,y,reading\n00:05,1,2,5\n00:06,1,2,5\n", "its time is no date"),
        ("t,x,y,reading\n0,-9999,2,5\n1,1,2,5\n", "x of row 1 is not a number"),
    ],
)
def test_logs_that_are_refused(tmp_path, text, reported):
    (tmp_path / "log.csv").write_text(text)
    with pytest.raises(ReadingsError, match=reported):
        read_log(tmp_path / "log.csv")


def test_numbers_that_mean_none_are_those_of_the_file(tmp_path):
    """Before conversion, in readings and wind alone, in all kinds of tables."""
    frame = pandas.DataFrame(LOG, columns=["t", "x", "y", "reading (ppb)"])
    frame.loc[1, "reading (ppb)"] = -9999
    frame.loc[2, "reading (ppb)"] = 0
    frame.to_csv(tmp_path / "log.csv", index=False)
    frame.to_parquet(tmp_path / "log.parquet")
    for source in (frame, tmp_path / "log.csv", tmp_path / "log.parquet"):
        log = read_log(source, missing=[0])
        assert log.t.tolist() == [0.0, 1.0, 2.0]
        np.testing.assert_allclose(log.reading, [0.005, np.nan, np.nan])
        assert (
            "1 of 3 values of reading (ppb) are" in " ".join(log.facts.remarks)
            or "2 of 3" in log.facts.remarks[0]
        )


def test_readings_that_may_mean_none_are_remarked(tmp_path):
    for value, part in ((-99.0, "go down to -99 ppm"), (65535.0, "1 readings are 65535 ppm")):
        frame = pandas.DataFrame([*LOG, (3.0, 1.0, 1.0, value)], columns=["t", "x", "y", "reading"])
        assert part in " ".join(read_log(frame).facts.remarks)
    assert read_log(pandas.DataFrame(LOG, columns=["t", "x", "y", "reading"])).facts.remarks == ()


def test_tables_of_pandas_with_all_kinds_of_times():
    start = pandas.Timestamp("2026-01-01T10:00:00Z")
    frame = pandas.DataFrame(LOG, columns=["t", "x", "y", "reading"])
    dated = frame.assign(t=start + pandas.to_timedelta(frame["t"].tolist(), unit="s"))
    for source in (dated, dated.assign(t=dated["t"].astype(str)), dated.set_index("t")):
        np.testing.assert_allclose(read_log(source).t, start.timestamp() + frame["t"])
    lasting = frame.assign(t=pandas.to_timedelta(frame["t"].tolist(), unit="s"))
    np.testing.assert_allclose(read_log(lasting).t, frame["t"])
    numbered = frame.set_axis([0, 1, 2, 3], axis=1)
    with pytest.raises(ReadingsError, match="has no column '4' for reading"):
        read_log(numbered, columns={"t": "0", "x": "1", "y": "2", "reading": "4"})
