"""Pictures made from fields equal the pictures of the recording."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from taichi_plume.__main__ import main
from taichi_plume.cli import run
from taichi_plume.files.run_folder import RunFolderError
from taichi_plume.results.pictures import pictures, wind
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


@contextmanager
def only_fields(folder: Path) -> Iterator[Run]:
    (folder / "pictures.zarr").rename(folder / "elsewhere")
    try:
        yield Run(folder, lenient=True)
    finally:
        (folder / "elsewhere").rename(folder / "pictures.zarr")


def test_pictures_of_a_film_are_those_of_the_recording(folder):
    recorded = pictures(Run(folder, lenient=True), None, (0.4, 2.0))
    with only_fields(folder) as of_film:
        filmed = pictures(of_film, None, (0.4, 2.0))
    assert {"gas_slice", "gas_column", "gas_section"} <= set(filmed) == set(recorded)
    for name, one in filmed.items():
        other = recorded[name]
        np.testing.assert_allclose(one.time, other.time, atol=1e-6)
        assert [one.attrs[key] for key in ("plane", "axes", "cell", "units")] == [
            other.attrs[key] for key in ("plane", "axes", "cell", "units")
        ]
        assert np.nanmax(one) > 10
        precision = {"rtol": other.attrs["relative_precision"], "atol": other.attrs["absolute_precision"]}
        np.testing.assert_allclose(other, one, equal_nan=True, **precision)


@pytest.mark.parametrize("plane", ["slice", "section"])
def test_wind_of_a_film_is_that_of_the_recording(folder, plane):
    recorded = wind(Run(folder, lenient=True), plane, (2.0, 2.0))
    with only_fields(folder) as of_film:
        filmed = wind(of_film, plane, (2.0, 2.0))
    assert recorded is not None
    assert filmed is not None
    assert set(filmed) == set(recorded)
    for name, one in filmed.items():
        np.testing.assert_allclose(recorded[name], one, atol=0.02 * float(abs(one).max()))


def test_fields_of_another_room_are_reported_in_a_line(folder):
    it = Run(folder, lenient=True)
    domain = it.scenario.domain.model_copy(update={"size": (2.0, 1.25, 0.5)})
    other = it.scenario.model_copy(update={"domain": domain})
    with only_fields(folder) as of_film:
        vars(of_film)["scenario"] = other
        with pytest.raises(RunFolderError, match="of another run") as error:
            pictures(of_film)
    assert str(error.value).startswith(f"{folder / 'fields.zarr'}: ")


def test_the_command_takes_them_where_there_is_no_recording(folder, tmp_path, capsys):
    with only_fields(folder):
        assert main(["picture", str(folder), "--out", str(tmp_path / "x.png"), "--width", "300"]) == 0
    assert "gas column at t = 2 s" in capsys.readouterr().out
