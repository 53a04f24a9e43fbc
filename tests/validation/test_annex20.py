"""The room of Annex 20: its numbers, what is read of a flow, and a short run of it on coarse cells."""

import numpy as np
import pytest

from taichi_plume.scenario.winds import CfdWind
from taichi_plume.validation import annex20, measured_air
from taichi_plume.validation.flow_cases import velocities
from taichi_plume.validation.measured_air import Times

pytestmark = [pytest.mark.usefixtures("taichi"), pytest.mark.slow]


def test_the_tables_hold_what_is_known_of_them():
    """Of Restivo's measurements by another source than the table's: the extremes and where they are."""
    floor, six = annex20.LINES["z = 0.084 m"], annex20.LINES["x = 6 m"]
    assert [len(line.u) for line in annex20.LINES.values()] == [28, 28, 25, 25]
    assert (six.u.max(), six.u.min()) == (0.286, -0.144)
    assert (floor.u.min(), floor.along[floor.u.argmin()]) == (-0.154, 6.5)
    for one, other in (("z = 2.916 m", "x = 3 m"), ("z = 2.916 m", "x = 6 m")):
        along, across = annex20.LINES[one], annex20.LINES[other]
        x, z = across.places[0][0], annex20.HIGH
        # two instruments at the same place
        assert np.interp(x, along.along, along.u) == pytest.approx(
            np.interp(z, across.along, across.u), abs=0.03
        )


@pytest.mark.parametrize("wide", [None, annex20.LAYER, annex20.ROOM])
def test_the_slots_are_openings_of_a_scenario(wide):
    wind = CfdWind.model_validate({"kind": "cfd"} | annex20.wind(wide))
    inlet, outlet = wind.openings[:2]
    width = wide or 1.0
    extent = (annex20.LENGTH, *((wide,) if wide else ()), annex20.HEIGHT)
    assert inlet.region.area(extent, 1.0) == pytest.approx(annex20.SLOT * width)
    assert outlet.region.area(extent, 1.0) == pytest.approx(annex20.OUTLET * width)
    reynolds = annex20.U0 * annex20.SLOT / wind.viscosity
    assert reynolds == pytest.approx(5000, rel=0.03)


def test_a_linear_field_is_read_exactly():
    dx, n = 0.1, 30
    x, z = np.arange(90) * dx, (np.arange(n) + 0.5) * dx
    mean = 0.02 * x[:, None] - 0.1 * z
    for line in annex20.LINES.values():
        inside = (line.places[:, 1] > 0.05) & (line.places[:, 1] < 2.95) & (line.places[:, 0] <= x[-1])
        places = line.places[inside]
        np.testing.assert_allclose(
            measured_air.along_x(mean, dx, places), 0.02 * places[:, 0] - 0.1 * places[:, 1], atol=1e-12
        )
    above = [[1.0, 3.0]]
    assert measured_air.along_x(mean, dx, np.array(above))[0] == 0.0
    assert measured_air.along_x(mean, dx, np.array(above), top="slip")[0] == mean[10, -1]


def test_measured_air_itself_has_no_error():
    record = measured_air.Record(0.1, np.zeros((2, 90, 30)), [])
    still = annex20.quantities(record)
    points = np.concatenate([line.u for line in annex20.LINES.values()])
    assert still["u/U0, rms of all points"] == pytest.approx(np.sqrt(np.mean(points**2)) / annex20.U0)
    assert still["u/U0, rms between both halves of the time"] == 0.0


def test_a_short_run_keeps_its_air_and_goes_on_on_other_cells():
    """What comes in goes through every section of the room; finer cells begin with what the coarser ones ended with."""
    mesh = annex20.Mesh(1, None, Times(2.0, 4.0, 1.0), seeds=1)
    record = annex20.record(mesh, seed=1)
    assert record.halves.shape == (2, 54, 18)
    for half in record.halves:
        np.testing.assert_allclose(half.sum(axis=1) * record.dx, annex20.U0 * annex20.SLOT, rtol=1e-4)
    same = measured_air.flow_in_box(annex20.wind(None), (54, 18), record.dx, seed=1)
    same.start_from(measured_air.as_before(record))
    finer = measured_air.flow_in_box(annex20.wind(None), (108, 36), record.dx / 2, seed=1)
    finer.start_from(measured_air.as_before(record))
    for d, (before, after, fine) in enumerate(
        zip(record.end, velocities(same), velocities(finer), strict=True)
    ):
        inner = tuple(slice(2, -2) for _ in range(2))
        assert np.abs(after - before)[inner].max() < 0.03, d
        coarse = fine.reshape(54, 2, 18, 2).mean(axis=(1, 3))
        assert np.corrcoef(coarse[inner].ravel(), before[inner].ravel())[0, 1] > 0.95, d


def test_the_report_shows_every_mesh_beside_what_was_measured(monkeypatch):
    mesh = annex20.Mesh(1, None, Times(2.0, 4.0, 1.0), seeds=1)
    monkeypatch.setattr(annex20, "MESHES", (mesh,))
    finest = mesh._replace(coarser=mesh, times=Times(1.0, 2.0, 1.0), width=None)
    reported = annex20.all_meshes(3, finest)
    assert (annex20.PUBLISHED.keys() | annex20.EXPECTED.keys()) <= reported.keys()
    assert reported["u/U0, rms of all points"].n == 1  # no more seeds than the mesh has
    for name, line in annex20.LINES.items():
        picture = reported[f"u along {name}"]
        np.testing.assert_allclose(picture.lines["measured"] * annex20.U0, line.u)
        assert picture.lines[finest.name].shape == line.along.shape
