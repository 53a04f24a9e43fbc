"""Statistics of a run's pictures are those of its film, within the precision that the pictures state."""

import shutil

import numpy as np
import pytest
import yaml

import taichi_plume as tp
from taichi_plume.cli import run as command

pytestmark = pytest.mark.usefixtures("taichi")
ROOM = {
    "name": "room",
    "duration": 2,
    "warm_up": 1,
    "tick": 0.05,
    "domain": {"size": [2, 1], "spacing": 0.1},
    "wind": {"kind": "synthetic", "speed": 0.3},
    "obstacles": [{"kind": "cylinder", "center": [1.3, 0.5], "radius": 0.2}],
    "gas": {"kind": "eulerian", "sources": [{"position": [0.4, 0.4], "rate": "50 mg/s"}]},
    "recording": {"rate": 20, "range_ppm": [0.1, 100]},
    "fields": {"rate": 20, "quantities": ["gas"]},
}  # fmt: skip


def test_pictures_stand_for_a_film(taichi, tmp_path):
    (tmp_path / "room.yaml").write_text(yaml.safe_dump(ROOM), encoding="utf-8")
    folder = tmp_path / "run"
    arguments = [str(tmp_path / "room.yaml"), "--out", str(folder), "--quiet", "--no-report"]
    assert command.main(arguments) == 0
    of_film = tp.statistics(folder, threshold=5.0)
    shutil.rmtree(folder / "fields.zarr")
    of_pictures = tp.statistics(folder, threshold=5.0)
    assert (of_film.of, of_pictures.of) == ("film", "pictures")
    assert (of_pictures.begin, of_pictures.samples) == (of_film.begin, of_film.samples)
    about = tp.open_run(folder).pictures["gas_slice"].attrs
    film, pictures = of_film.maps, of_pictures.maps
    assert film is not None
    assert pictures is not None
    assert np.isnan(film["mean"]).any()
    assert film["mean"].max() > 5.0
    for name in ("mean", "maximum"):
        np.testing.assert_allclose(
            pictures[name], film[name], rtol=about["relative_precision"], atol=about["absolute_precision"]
        )
    assert [one.probe.name for one in of_pictures.probes] == [one.probe.name for one in of_film.probes]
    percent = f"{100 * about['relative_precision']:.2g} percent"
    assert any(percent in note for note in of_pictures.notes)
    assert any("0.05 s apart" in note for note in of_pictures.notes)
