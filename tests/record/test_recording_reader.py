from pathlib import Path

import made_run
import numpy as np
import pytest

from taichi_plume.files.run_folder import RunFolderError
from taichi_plume.record.recording_reader import RecordedPictures, dataset


@pytest.fixture(scope="module")
def room(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("reading") / "recording.rrd"
    made_run.record(
        path,
        {
            "gas/slice": {"plane": "0.1 m above the floor"},
            "gas/section": {"plane": "y = 1.5 m", "axes": "xz", "shape": (40, 10)},
            "temperature/slice": {
                "quantity": "temperature", "unit": "K", "low": 290.0, "high": 300.0, "scale": "linear",
                "shape": (20, 15), "cell": [0.2, 0.4], "origin": [1.0, 2.0],
            },
        },
    )  # fmt: skip
    return path


@pytest.fixture(scope="module")
def pictures(room):
    return dataset(RecordedPictures(room).read().values())


def test_bytes_become_concentrations_where_they_were(pictures):
    gas = pictures["gas_slice"]
    assert gas.dims == ("time", "y", "x")
    assert gas.dtype == np.float32
    assert gas.attrs["units"] == "ppm"
    assert gas.attrs["plane"] == "0.1 m above the floor"
    n = 10
    byte = made_run.pixels(n)
    expected = np.where(byte > 0, made_run.LOW * (made_run.HIGH / made_run.LOW) ** (byte / 255), 0.0)
    np.testing.assert_allclose(gas[n].transpose("x", "y"), expected, rtol=1e-5)
    peak = gas[n].where(gas[n] == gas[n].max(), drop=True)
    assert (float(peak.x[0]), float(peak.y[0])) == pytest.approx((2.35, 1.15))


def test_times_and_axes_are_those_of_cf(pictures):
    np.testing.assert_allclose(pictures.time, made_run.TIMES)
    assert [pictures[name].attrs["axis"] for name in ("time", "x", "y", "z")] == ["T", "X", "Y", "Z"]
    assert pictures["gas_section"].dims == ("time", "z", "x")


def test_planes_with_other_pixels_have_other_axes(pictures):
    warm = pictures["temperature_slice"]
    assert warm.dims == ("time", "y_slice", "x_slice")
    np.testing.assert_allclose(warm["x_slice"], 1.0 + 0.2 * (np.arange(20) + 0.5))
    np.testing.assert_allclose(warm["y_slice"], 2.0 + 0.4 * (np.arange(15) + 0.5))
    byte = made_run.pixels(22, (20, 15)).T.astype(float)
    np.testing.assert_allclose(warm[22], 290 + 10 * byte / 255, rtol=1e-6)


def test_a_part_of_the_frames_and_their_mean(room):
    recording = RecordedPictures(room)
    pictures = recording.read(["gas_slice"], between=(2.0, 6.0), spacing=1.0)
    assert list(pictures) == ["gas_slice"]
    gas = pictures["gas_slice"]
    np.testing.assert_allclose(gas.times, [2, 3, 4, 5, 6])
    np.testing.assert_array_equal(gas.data[0], made_run.pixels(6).T)
    np.testing.assert_allclose(gas.mean(), gas.values().astype(float).mean(axis=0), rtol=1e-6)
    assert gas.extent == pytest.approx((0, 4, 0, 3))
    assert recording.span() == recording.span(["gas_slice"]) == (-1.0, 10.0)
    assert recording.span(["none"]) is None


def test_a_species_has_the_planes_that_all_have(tmp_path):
    """Pictures of a species, below gas/0, have the planes of the whole gas and of the wind."""
    side = {"axes": "xz", "shape": (40, 10)}
    planes = {"gas/slice": {}, "gas/0/slice": {}, "gas/0/section_2": side}
    made_run.record(tmp_path / "two.rrd", planes)
    read = RecordedPictures(tmp_path / "two.rrd").read()
    views = {name: one.view for name, one in read.items()}
    assert views == {"gas_slice": "slice", "gas_0_slice": "slice", "gas_0_section_2": "section_2"}
    reported = dataset(read.values())
    names = [reported[name].attrs["long_name"] for name in ("gas_0_slice", "gas_slice")]
    assert names == ["ethanol, in a plane"] * 2


def test_arrows_of_a_changing_number(room):
    wind = RecordedPictures(room).arrows("slice")
    np.testing.assert_allclose(wind.times, made_run.TIMES)
    assert [len(tails) for tails in wind.tails] == [2 + n % 3 for n in range(len(made_run.TIMES))]
    np.testing.assert_allclose(wind.ways[4], [[0.5, 0, 0]] * 3)


def test_what_is_no_recording_of_ours_is_reported_in_a_line(room, tmp_path, monkeypatch):
    faults = {"none": "does not exist", "folder": "is a folder", "text": "no recording", "cut": "cut off"}
    faults |= {"old": "another version", "size": "another size"}
    (tmp_path / "folder.rrd").mkdir()
    (tmp_path / "text.rrd").write_text("hello")
    (tmp_path / "cut.rrd").write_bytes(room.read_bytes()[:3000])
    made_run.record(tmp_path / "old.rrd", scales=False)
    scales = [{"low": 0.0}, {"low": 5.0, "high": 5.0}, {"high": float("nan")}, {"cell": []}]
    for n, scale in enumerate(scales):
        made_run.record(tmp_path / f"scale{n}.rrd", **scale)
        faults[f"scale{n}"] = "damaged"
    shown = made_run.pixels
    monkeypatch.setattr(made_run, "pixels", lambda n, shape: shown(n, (39, 30)))
    made_run.record(tmp_path / "size.rrd")
    for name, fault in faults.items():
        path = tmp_path / f"{name}.rrd"
        with pytest.raises(RunFolderError, match=fault) as error:
            RecordedPictures(path).read()
        assert str(error.value).startswith(f"{path}: ")
        assert "\n" not in str(error.value)
