"""Readings from files: what real logs look like, and what is wrong with some."""

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from refusals import flipped, refused

from taichi_plume.files import manifest
from taichi_plume.files.readings import ReadingsError, read


@pytest.mark.parametrize(
    "text",
    [
        "t,x,y,reading\n2,0.5,1,7\n1,0,1,6\n",
        "t, x, y, reading\r\n2, 0.5, 1, 7\r\n1, 0, 1, 6\r\n",
        "\ufefft;x;y;reading\n2;0.5;1;7\n1;0;1;6\n",
        'a\ty\t"x"\treading\tt\ta\t\t\n-\t1\t0.5\t7\t2\t°\t\t\nb\t1\t0\t6\t1\t\t\t\n',
        "t,x,y,reading,believed_z,trial,group\n2,0.5,1,7,,0,\n1,0,1,6,,0,b\n9,9,9,9,,1,b\n",
    ],
)
def test_logs_of_all_sorts(text, tmp_path):
    path = tmp_path / "a.csv"
    path.write_text(text, encoding="utf-8", newline="")
    readings = read(str(path))
    assert readings.t.tolist() == [1.0, 2.0]
    assert readings.place.tolist() == [[0.0, 1.0], [0.5, 1.0]]
    assert readings.reading.tolist() == [6.0, 7.0]
    assert readings.wind.tolist() == [[0.0, 0.0]] * 2
    assert readings.row.tolist() == [2, 1]


def test_what_is_no_finite_number_is_no_reading(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("t,x,y,reading,wind_x,wind_y\n1,0,0,inf,nan,1\n2,0,0,-inf,inf,2\n3,0,0,,,\n4,0,0,5,1,2\n")
    readings = read(path)
    np.testing.assert_array_equal(readings.reading, [np.nan, np.nan, np.nan, 5.0])
    np.testing.assert_array_equal(readings.wind, [[0.0, 1.0], [0.0, 2.0], [0.0, 0.0], [1.0, 2.0]])


def run_table(path):
    """Two groups of a robot and two trials each, as a run writes them, at 0 and 1 s."""
    n = np.arange(8)
    columns = {
        "t": np.repeat([0.0, 1.0], 4),
        "group": pa.array(["red", "red", "blue", "blue"] * 2).dictionary_encode(),
        "trial": np.tile([0, 1], 4).astype(np.int32),
        "x": n + 0.5,
        "y": n * 0.0,
        "heading": n * 0.0,
        "believed_heading": n * 0.0 + 0.5,
        "believed_x": n * 1.0,
        "believed_y": n * 2.0,
        "reading_ppm": n * 10.0,
        "wind_x": n * 0.0 + 0.25,
        "wind_y": n * 0.0,
    }
    pq.write_table(pa.table(columns), path)
    return path


def test_a_run_tells_what_its_robots_believed(tmp_path):
    """The wind of a run is in the frame of the robots' beliefs already."""
    readings = read(run_table(tmp_path / "robots.parquet"), trial=1)
    assert readings.t.tolist() == [1.0, 1.0], "nothing has been measured at 0 s"
    assert readings.place.tolist() == [[5.0, 10.0], [7.0, 14.0]]
    assert readings.wind.tolist() == [[0.25, 0.0]] * 2
    assert readings.row.tolist() == [6, 8]


def test_one_group_of_many(tmp_path):
    path = run_table(tmp_path / "robots.parquet")
    assert read(path, group="blue").reading.tolist() == [60.0]
    assert read(path, 1, "red").reading.tolist() == [50.0]
    with pytest.raises(ReadingsError, match=r"has no group 'green'; it has blue, red$"):
        read(path, group="green")


@pytest.mark.parametrize(
    ("content", "chosen", "reported"),
    [
        (b"t,x,y,reading\n", {}, "has no readings"),
        (b"", {}, "is empty"),
        (b"t,x,reading\n1,0,2\n", {}, "has no column y; it has t, x, reading"),
        (b"1,0,0,2\n2,0,0,2\n", {}, "has no column t, x, y, reading; no line above its numbers names"),
        (b"t,x,y,reading\n1,0,0,2\0\n", {}, "line 2: is not plain text"),
        (b"t,x,y,reading\n1,0,0,2\n1,0,a,2\n", {}, "line 3: 'a' is no number"),
        (b"t;x;y;reading\n1;0,5;0.5;2\n", {}, "line 2: '0.5' is no number"),
        (b"t,x (s),y,reading\n1,0,0,2\n", {}, "x (s): 's' is no unit that converts to m"),
        (b"t,x,y,reading\n1,0,0,2\n1,0,nan,2\n", {}, "y of row 2 is not a number"),
        (b"t,x,y,x,reading\n1,0,0,0,2\n", {}, "has several columns 'x'"),
        (b"t,x,y,reading,trial\n1,0,0,2,first\n", {}, "line 2: 'first' is no number"),
        (b"t,x,y,reading,trial\n1,0,0,2,true\n", {}, "line 2: 'true' is no number"),
        (b"t,x,y,reading,trial\n1,0,0,2,\n", {}, "has no readings"),
        (b"t,x,y,reading,trial\n1,0,0,2,4\n", {"trial": 3}, "has no trial 3; the first is 4, the last 4"),
        (b"t,x,y,reading\n1,0,0,2\n", {"trial": 0}, "has no column 'trial' from which to select trial 0"),
        (b"t,x,y,reading\n1,0,0,2\n", {"group": "a"}, "has no column 'group' from which to select group 'a'"),
        (b"t,x,y,reading\n1,0\n", {}, "line 2: has 2 columns, not 4; is the file whole?"),
        (None, {}, "cannot be read: No such file or directory"),
    ],
)
def test_what_is_wrong_is_reported_in_one_line(content, chosen, reported, tmp_path):
    path = tmp_path / "a.csv"
    if content is not None:
        path.write_bytes(content)
    with refused(ReadingsError, path, f"{path}: {reported}"):
        read(path, **chosen)


def test_a_parquet_that_is_none(tmp_path):
    path = tmp_path / "a.parquet"
    path.write_bytes(b"t,x,y,reading\n")
    with pytest.raises(ReadingsError, match=r"a\.parquet: cannot be read: "):
        read(path)


def noisy_table(path):
    """Pages of numbers that do not shrink, with checksums."""
    rng = np.random.default_rng(2)
    table = pa.table({name: rng.normal(size=2000) for name in ("t", "x", "y", "reading")})
    pq.write_table(table, path, write_page_checksum=True, compression="none", use_dictionary=False)
    return path


@pytest.mark.parametrize("place", [100, 20_000, 40_000, 60_000])
def test_a_flipped_bit_of_a_page_is_noticed(tmp_path, place):
    path = noisy_table(tmp_path / "a.parquet")
    flipped("a.parquet", place)(tmp_path)
    with pytest.raises(ReadingsError, match=r"a\.parquet: cannot be read: .*CRC"):
        read(path)


def test_a_table_that_its_manifest_does_not_know_is_refused(tmp_path):
    path = noisy_table(tmp_path / "a.parquet")
    manifest.write(tmp_path, {}, [path])
    assert len(read(path).t) == 2000
    content = path.read_bytes()
    path.write_bytes(content.replace(b"reading", b"wind_xx"))  # in the footer, which has no checksum
    with pytest.raises(ReadingsError, match="has changed since its run"):
        read(path)


@pytest.mark.parametrize(
    ("row", "fault"),
    [
        ("1e300,0,0,5,0,0", r"t of row 2 is 1e\+300, a mistake; at most 1e\+10 is allowed"),
        ("2,-1e300,0,5,0,0", r"x of row 2 is -1e\+300"),
        ("2,0,1e9,5,0,0", r"y of row 2 is 1e\+09"),
        ("2,0,0,-1e30,0,0", r"reading of row 2 is -1e\+30"),
        ("2,0,0,5,0,1e30", r"wind_y of row 2 is 1e\+30"),
    ],
)
def test_numbers_beyond_reason_are_refused(tmp_path, row, fault):
    path = tmp_path / "a.csv"
    path.write_text(f"t,x,y,reading,wind_x,wind_y\n1,0,0,inf,nan,1\n{row}\n")
    with pytest.raises(ReadingsError, match=fault):
        read(path)


def test_the_rows_of_a_parquet_are_bounded(tmp_path, monkeypatch):
    """A page of equal values packs millions of rows into a few bytes."""
    zeros = {name: np.zeros(1000) for name in ("t", "x", "y", "reading")}
    pq.write_table(pa.table(zeros), tmp_path / "a.parquet")
    assert len(read(tmp_path / "a.parquet").t) == 1000
    monkeypatch.setattr("taichi_plume.files.readings.MOST_ROWS", 999)
    with pytest.raises(ReadingsError, match="1,000 rows; at most 999"):
        read(tmp_path / "a.parquet")
