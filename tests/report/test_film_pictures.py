"""Pictures made from fields equal the pictures of the recording."""

from pathlib import Path

import numpy as np
import pytest

from taichi_plume.__main__ import main
from taichi_plume.cli import run
from taichi_plume.files.run_folder import RunFolderError
from taichi_plume.results.film_pictures import FilmPictures
from taichi_plume.results.run import Run

pytestmark = [pytest.mark.usefixtures("taichi"), pytest.mark.slow]

SCENARIO = """
duration: 2
domain: {size: [2, 1.5, 0.5], spacing: 0.125}
wind: {kind: synthetic}
obstacles: [{kind: box, center: [1.4, 0.9, 0.1], size: [0.4, 0.3, 0.2]}]
gas: {kind: eulerian, sources: [{position: [0.6, 0.7, 0.2], rate: 5 mg/s, radius: 0.1}]}
recording: {rate: 2, wind_rate: 1, volume: false}
fields: {rate: 2}
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("film")
    (path / "s.yaml").write_text(SCENARIO)
    assert run.main([str(path / "s.yaml"), "--out", str(path / "run"), "--quiet", "--no-report"]) == 0
    return path / "run"


def test_pictures_are_those_of_the_recording(folder):
    it = Run(folder, lenient=True)
    recorded = it.planes.read(None, (0.4, 2.0))
    filmed = FilmPictures(folder / "fields.zarr", it.scenario).read(None, (0.4, 2.0))
    assert filmed.keys() == recorded.keys()
    assert {"gas_slice", "gas_column", "gas_section"} <= filmed.keys()
    for name, one in filmed.items():
        other = recorded[name]
        np.testing.assert_allclose(one.times, other.times, atol=1e-6)
        assert (one.plane, one.axes, one.cell, one.unit) == (other.plane, other.axes, other.cell, other.unit)
        assert one.data.max() > 100
        assert np.abs(one.data.astype(int) - other.data).max() <= 1


@pytest.mark.parametrize("plane", ["slice", "section"])
def test_arrows_point_where_those_of_the_recording_do(folder, plane):
    it = Run(folder, lenient=True)
    recorded = it.planes.arrows(plane)
    filmed = FilmPictures(folder / "fields.zarr", it.scenario).arrows(plane, (2.0, 2.0))
    ways, tails = recorded.ways[-1], recorded.tails[-1]
    middles = filmed.tails[0] + filmed.ways[0] / 2
    axes = [0, 1] if plane == "slice" else [0, 2]
    close = 0
    for tail, way in zip(tails, ways, strict=True):
        apart = np.abs(middles[:, axes] - (tail + way / 2)[axes]).max(axis=-1)
        own = filmed.ways[0][apart.argmin()]
        close += apart.min() < 1e-3 and own @ way > 0.98 * np.linalg.norm(own) * np.linalg.norm(way)
    assert close > 0.9 * len(ways) > 5


def test_fields_of_another_room_are_reported_in_a_line(folder):
    it = Run(folder, lenient=True)
    domain = it.scenario.domain.model_copy(update={"size": (2.0, 1.25, 0.5)})
    other = it.scenario.model_copy(update={"domain": domain})
    with pytest.raises(RunFolderError, match="of another run") as error:
        FilmPictures(folder / "fields.zarr", other).read()
    assert str(error.value).startswith(f"{folder / 'fields.zarr'}: ")


def test_the_command_takes_them_where_there_is_no_recording(folder, tmp_path, capsys):
    (folder / "recording.rrd").rename(tmp_path / "elsewhere.rrd")
    try:
        assert main(["picture", str(folder), "--out", str(tmp_path / "x.png"), "--width", "300"]) == 0
    finally:
        (tmp_path / "elsewhere.rrd").rename(folder / "recording.rrd")
    assert "gas column at t = 2 s" in capsys.readouterr().out
