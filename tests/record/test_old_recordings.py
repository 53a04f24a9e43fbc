"""Recordings whose pictures were colours, and the numbers that `export --to pictures` makes of these."""

from pathlib import Path
from typing import Any

import made_run
import numpy as np
import pytest
import rerun as rr

from taichi_plume.__main__ import main
from taichi_plume.files.run_folder import RunFolderError
from taichi_plume.record.drawing import rows
from taichi_plume.record.old_recordings import convert
from taichi_plume.report.page import write
from taichi_plume.results.run import Run, open_run
from taichi_plume.version import __version__

LOW, HIGH = 0.1, 1000.0
TIMES = np.arange(-1.0, 10.01, 0.5)
PEAK = (23, 11)  # pixel of the largest concentration, of 40 x 30 pixels of 0.1 m
SIDE = {"plane": "y = 1.5 m", "axes": "xz", "shape": (40, 10)}


def pixels(n: int, shape: tuple[int, int] = (40, 30)) -> np.ndarray:
    """Bytes (nx, ny) of frame n: a slope with one peak that grows, 0 in the left half."""
    x, y = np.meshgrid(*(np.arange(k) for k in shape), indexing="ij")
    away = np.hypot(x - PEAK[0], y - PEAK[1])
    return np.where(x > 15, np.clip(100 + 6 * n - 8 * away, 0, 255), 0).astype(np.uint8)


def concentration(byte: np.ndarray) -> np.ndarray:
    return np.where(byte > 0, LOW * (HIGH / LOW) ** (byte / 255), 0.0)


def record(path: Path, planes: dict[str, dict[str, Any]], scales: bool = True, **about: Any) -> None:
    """Write a recording as versions before pictures.zarr did. planes: of each entity its values, and `shape`."""
    stream = rr.RecordingStream("taichi_plume", recording_id="made")
    stream.set_log_time_enabled(False)
    stream.save(path)
    for entity, values in planes.items():
        shape = values.get("shape", (40, 30))
        form = rr.components.ImageFormat(
            width=shape[0], height=shape[1], color_model="L", channel_datatype="U8"
        )
        stream.log(entity, rr.GridMap.from_fields(format=form, cell_size=0.1), static=True)
        stated = {
            "quantity": "ethanol", "unit": "ppm", "low": LOW, "high": HIGH, "scale": "log", "plane": "",
            "axes": "xy", "cell": 0.1, "origin": [0.0, 0.0],
        }  # fmt: skip
        stated |= about | {key: value for key, value in values.items() if key != "shape"}
        if scales:
            stream.log(entity, rr.AnyValues(**stated), static=True)
    for n, t in enumerate(TIMES):
        stream.set_time("sim_time", duration=float(t))
        for entity, values in planes.items():
            stream.log(entity, rr.GridMap.from_fields(data=rows(pixels(n, values.get("shape", (40, 30))))))
        stream.log("wind/slice", rr.Arrows3D(origins=[[1.0, 0.5, 0]], vectors=[[0.5, 0, 0]]))
    stream.flush()
    stream.disconnect()


def old_run(folder: Path, planes: dict[str, dict[str, Any]]) -> Path:
    model = made_run.scenario(3)
    made_run.made(folder, model, False, content=made_run.result(model, version=__version__))
    record(folder / "recording.rrd", planes)
    return folder


@pytest.fixture(scope="module")
def room(tmp_path_factory) -> Path:
    warm = {
        "quantity": "temperature", "unit": "K", "low": 290.0, "high": 300.0, "scale": "linear",
        "shape": (20, 15), "cell": [0.2, 0.4], "origin": [1.0, 2.0],
    }  # fmt: skip
    planes = {
        "gas/slice": {"plane": "0.3 m above the floor"},
        "gas/section": SIDE,
        "temperature/slice": warm,
    }
    folder = old_run(tmp_path_factory.mktemp("old") / "room", planes)
    with pytest.raises(RunFolderError, match=r"export .* --to pictures"):
        open_run(folder).plot()
    assert main(["export", str(folder), "--to", "pictures"]) == 0
    return folder


def test_bytes_become_concentrations_where_they_were(room):
    gas = open_run(room).pictures["gas_slice"]
    assert gas.dims == ("time", "y", "x")
    assert (gas.dtype, gas.attrs["units"], gas.attrs["plane"]) == (np.float32, "ppm", "0.3 m above the floor")
    byte = pixels(10)
    np.testing.assert_allclose(gas[10].transpose("x", "y"), concentration(byte), rtol=1e-5)
    peak = gas[10].where(gas[10] == gas[10].max(), drop=True)
    assert (float(peak.x[0]), float(peak.y[0])) == pytest.approx((2.35, 1.15))


def test_the_stated_precision_is_that_of_256_colours(room):
    about = open_run(room).pictures["gas_slice"].attrs
    gas = np.geomspace(LOW / 3, HIGH, 5000)
    byte = np.clip(np.log(np.maximum(gas / LOW, 1.0)) * 255 / np.log(HIGH / LOW) + 0.5, 0, 255).astype(int)
    error = np.abs(concentration(byte) - gas)
    allowed = about["relative_precision"] * gas + about["absolute_precision"]
    assert (error <= allowed * (1 + 1e-9)).all()
    assert (error / gas)[gas > 2 * LOW].max() == pytest.approx(about["relative_precision"], rel=0.02)
    assert about["largest_value"] == HIGH
    warm = open_run(room).pictures["temperature_slice"].attrs
    assert (warm["relative_precision"], warm["absolute_precision"]) == (0.0, pytest.approx(10 / 255 / 2))
    assert "256 colours" in about["comment"]


def test_times_and_axes_are_those_of_cf(room):
    data = open_run(room).pictures
    np.testing.assert_allclose(data.time, TIMES)
    assert [data[name].attrs["axis"] for name in ("time", "x", "y", "z")] == ["T", "X", "Y", "Z"]
    assert data["gas_section"].dims == ("time", "z", "x")


def test_planes_with_other_pixels_have_other_axes(room):
    warm = open_run(room).pictures["temperature_slice"]
    assert warm.dims == ("time", "y_slice", "x_slice")
    np.testing.assert_allclose(warm["x_slice"], 1.0 + 0.2 * (np.arange(20) + 0.5))
    np.testing.assert_allclose(warm["y_slice"], 2.0 + 0.4 * (np.arange(15) + 0.5))
    np.testing.assert_allclose(warm[22], 290 + 10 * pixels(22, (20, 15)).T.astype(float) / 255, rtol=1e-6)


def test_gas_at_a_position_is_read_from_the_plane_through_it(room):
    run = open_run(room)
    gas = run.gas_at(2.35, 1.15, 0.3)["ethanol_ppm"]
    expected = concentration(np.array([pixels(k)[PEAK] for k in range(len(TIMES))]))
    np.testing.assert_allclose(gas, expected, rtol=1e-5)
    assert gas.attrs["relative_precision"] == pytest.approx(np.log(HIGH / LOW) / 510, rel=0.02)


def test_report_and_figures_are_made_of_a_converted_run(room):
    page = write(Run(room, lenient=True)).read_text(encoding="utf-8")
    assert "data:image" in page
    axes = open_run(room).plot(5.0, "slice", wind=False).axes[0]
    drawn = np.asarray(axes.images[0].get_array())
    assert drawn.shape[:2] == (30, 40)


def test_a_species_has_the_planes_that_all_have(tmp_path):
    planes = {
        "gas/slice": {"quantity": "ethanol + acetone"},
        "gas/0/slice": {},
        "gas/0/section_2": SIDE,
    }
    folder = old_run(tmp_path / "two", planes)
    assert main(["export", str(folder), "--to", "pictures"]) == 0
    data = open_run(folder).pictures
    views = {str(name): data[name].attrs["view"] for name in data.data_vars}
    assert views == {"gas_slice": "slice", "gas_0_slice": "slice", "gas_0_section_2": "section_2"}
    assert [data[name].attrs.get("species") for name in ("gas_slice", "gas_0_slice")] == [None, "ethanol"]
    assert data["gas_0_slice"].attrs["long_name"] == "ethanol, in a plane"


def test_pictures_are_never_replaced(room, capsys):
    before = (room / "pictures.zarr" / "zarr.json").read_bytes()
    assert main(["export", str(room), "--to", "pictures", "--force"]) == 2
    assert "exists" in capsys.readouterr().err
    assert (room / "pictures.zarr" / "zarr.json").read_bytes() == before


def test_what_is_no_recording_of_ours_is_reported_in_a_line(room, tmp_path, monkeypatch):
    faults = {"none": "does not exist", "folder": "is a folder", "text": "no recording", "cut": "cut off"}
    faults |= {"old": "another version", "size": "another size"}
    flat: dict[str, dict[str, Any]] = {"gas/slice": {}}
    (tmp_path / "folder.rrd").mkdir()
    (tmp_path / "text.rrd").write_text("hello")
    (tmp_path / "cut.rrd").write_bytes((room / "recording.rrd").read_bytes()[:3000])
    record(tmp_path / "old.rrd", flat, scales=False)
    scales = [{"low": 0.0}, {"low": 5.0, "high": 5.0}, {"high": float("nan")}, {"cell": []}]
    for n, scale in enumerate(scales):
        record(tmp_path / f"scale{n}.rrd", flat, **scale)
        faults[f"scale{n}"] = "damaged"
    shown = pixels
    monkeypatch.setitem(globals(), "pixels", lambda n, shape: shown(n, (39, 30)))
    record(tmp_path / "size.rrd", flat)
    for name, fault in faults.items():
        path = tmp_path / f"{name}.rrd"
        with pytest.raises(RunFolderError, match=fault) as error:
            convert(path, tmp_path / f"{name}.zarr", made_run.scenario(), {})
        assert str(error.value).startswith(f"{path}: ")
        assert "\n" not in str(error.value)
