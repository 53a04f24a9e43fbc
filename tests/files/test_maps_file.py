"""`maps.zarr` is opened by others without a warning, holds what the maps said, and is refused in a line if damaged."""

import errno
import json
import shutil
import warnings
from pathlib import Path
from typing import Any

import fake_run
import numpy as np
import pytest
import xarray
from refusals import cut, gone, refused, replaced

from taichi_plume.execution import maps_output
from taichi_plume.files import maps_file, zarr_groups
from taichi_plume.files.run_folder import RunFolderError
from taichi_plume.report.maps import maps_of
from taichi_plume.scoring.maps import MapScores

pytestmark = pytest.mark.usefixtures("taichi")


@pytest.fixture(scope="module")
def ended(tmp_path_factory) -> tuple[Any, MapScores, Path]:
    """A run that is over, its scores and its maps; the second one tells a variance, and knows half the cells."""
    sim: Any = fake_run.simulation(fake_run.scenario(2, duration=6))
    judge = MapScores(sim)
    sim.observers.append(judge.observer())
    path = tmp_path_factory.mktemp("run") / "maps.zarr"
    writer = maps_output.MapsFile(sim, path, judge)
    writer.start()
    sim.run()
    last, says = sim.maps[-1], sim.maps[-1].estimate

    def half() -> np.ndarray:
        return np.where(np.arange(last.shape[0])[:, None] % 2, np.nan, says())

    last.estimate, last.variance, last.noise = half, lambda: half() ** 2 + 1, 0.0
    writer.close()
    return sim, judge, path


@pytest.fixture
def path(ended, tmp_path) -> Path:
    """A copy to damage."""
    return shutil.copytree(ended[2], tmp_path / "maps.zarr")


def test_it_holds_what_the_maps_say(ended):
    sim, judge, path = ended
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        held = [xarray.open_zarr(path, group=str(n)) for n in range(len(sim.maps))]
    assert len(held) > 1
    for one, series, model in zip(held, judge.series, sim.scenario.maps, strict=True):
        estimate = series.map.estimate()
        assert one["estimate"].dims == one["truth"].dims == ("trial", "y", "x")
        np.testing.assert_array_equal(one["estimate"], np.float32(estimate.transpose(0, 2, 1)))
        np.testing.assert_array_equal(one["weight"], np.float32(series.map.weight().transpose(0, 2, 1)))
        for trial in range(len(estimate)):
            np.testing.assert_allclose(one["truth"][trial], series.truth.T, rtol=1e-6)
        np.testing.assert_array_equal(one["measurable"], series.measurable.T)
        at = one["estimate"].sel(x=0.6 * model.cell, y=2.4 * model.cell, method="nearest")
        np.testing.assert_array_equal(at, np.float32(estimate[:, 0, 2]))
        assert one["estimate"].attrs["units"] == "ppm"
        assert one.attrs["kind"] == model.kind
        assert one.attrs["t_s"] == sim.t
    assert "variance" not in held[0]
    np.testing.assert_allclose(held[-1]["variance"], held[-1]["estimate"] ** 2 + 1, rtol=1e-6)
    assert np.isnan(held[-1]["estimate"]).any()
    assert sum(part["trials"] for part in json.loads(held[0].attrs["groups"])) == held[0].sizes["trial"]


def test_it_is_read_as_it_was_written_and_axes_are_found(ended):
    import cf_xarray  # noqa: F401

    for n, one in enumerate(maps_file.read(ended[2])):
        assert one.identical(xarray.open_zarr(ended[2], group=str(n)))
        assert (one.cf["X"].name, one.cf["Y"].name) == ("x", "y")


def linked(path: Path) -> None:
    chunk = path / "1" / "y" / "c" / "0"
    chunk.unlink()
    chunk.symlink_to("/dev/zero")


@pytest.mark.parametrize(
    ("damage", "fault"),
    [
        (shutil.rmtree, "does not exist"),
        (cut("zarr.json"), "is damaged"),
        (gone("zarr.json"), "is damaged"),
        (replaced("zarr.json", "taichi_plume maps 2", "taichi_plume maps 0"), "was made by another version"),
        (cut("0/estimate/c/0/0/0", 0.9), "is damaged: Stored and computed"),
        (gone("0/truth/c/0/0/0"), "truth has 0 of 1 chunks"),
        (gone("1"), "is damaged"),
        (gone("0/estimate"), "is damaged"),
        (cut("1/x/zarr.json"), "is damaged"),
        (linked, "which is no plain file"),
    ],
)
def test_damage_is_reported_in_a_line(path, damage, fault):
    damage(path)
    with refused(RunFolderError, path, fault):
        maps_file.read(path)
    if path.exists():
        with refused(RunFolderError, path, ""):
            maps_of(path.parent)


def test_the_report_says_whose_of_rivals_maps_it_shows(path):
    assert [one.name for one in maps_of(path.parent)] == [
        f"{one.attrs['kind'].replace('_', ' ')} map" for one in maps_file.read(path)
    ]
    about = json.loads((path / "0" / "zarr.json").read_text())
    about["attributes"]["groups"] = json.dumps([{"names": [name]} for name in ("first", "second")])
    (path / "0" / "zarr.json").write_text(json.dumps(about))
    assert maps_of(path.parent)[0].name.endswith(" map of first")


def test_a_run_that_goes_on_has_no_maps_of_its_earlier_end(ended, path):
    sim, judge, _ = ended
    writer = maps_output.MapsFile(sim, path, judge)
    writer.resume()
    assert not path.exists()
    writer.flush()
    assert not path.exists()
    writer.close()
    assert maps_file.read(path)[0].identical(maps_file.read(ended[2])[0])


def test_a_full_disk_leaves_no_half_of_a_file(ended, tmp_path, monkeypatch):
    sim, judge, _ = ended
    writer = maps_output.MapsFile(sim, tmp_path / "maps.zarr", judge)
    writer.start()

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left")

    monkeypatch.setattr(zarr_groups, "consolidate", full)
    with pytest.raises(OSError, match="No space"):
        writer.close()
    assert not list(tmp_path.iterdir())
