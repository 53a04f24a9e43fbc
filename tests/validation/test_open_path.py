import numpy as np
import pytest

from taichi_plume.validation import open_path
from taichi_plume.validation.open_path import REFLECTORS, SENSOR, Minutes, Release
from taichi_plume.validation.published_data import VARIABLE, MissingDataError

SOURCE, RATE = np.array([60.0, 40.0]), 4e-4
MADE = Release("20170101/rel99", "10:00:00", "10:21:00", RATE)


def made(minutes: int = 20) -> Minutes:
    """Winds that sweep a plume over the beams; its path means lie over backgrounds that differ from beam to beam."""
    angle = np.radians(np.linspace(140.0, 240.0, minutes))
    wind = 2.5 * np.column_stack([np.cos(angle), np.sin(angle)])
    empty = Minutes(np.zeros((minutes, 7)), wind, (0.2, 0.12), 0.68)
    backgrounds = 1.9 + 0.02 * np.arange(7)
    return empty._replace(ppm=backgrounds + RATE * open_path.enhancements(empty, SOURCE[None])[0])


def test_a_made_release_is_found_with_its_position():
    found = open_path.estimate(made())
    assert found.strength == pytest.approx(RATE, rel=0.1)
    assert found.position == pytest.approx(SOURCE, abs=2.0)
    assert found.backgrounds.mean() == pytest.approx(1.96, abs=0.03)


def test_air_without_a_plume_has_no_source():
    minutes = made()
    clean = minutes._replace(ppm=np.full_like(minutes.ppm, open_path.BACKGROUND))
    assert open_path.estimate(clean).strength < 0.05 * RATE


def test_a_plume_across_a_beam_carries_the_strength():
    wind = np.array([[-2.0, 0.0]])
    minutes = Minutes(np.zeros((1, 7)), wind, (0.1, 0.1), 1.0)
    mean = open_path.enhancements(minutes, np.array([[60.0, 59.0]]))[0, 0, 3]  # beam 4 runs along y
    width = open_path.RADIUS + 0.1 * 25.0
    level = 2.0 * np.exp(-0.5 * (1.6 / width) ** 2) / (np.sqrt(2.0 * np.pi) * width)
    assert mean * 98.0 == pytest.approx(1e6 * level / 2.0, rel=1e-3)


def test_records_of_the_data_set_are_read(tmp_path, monkeypatch):
    minutes = made()
    folder = tmp_path / "open_path" / MADE.folder / "Raw_data"
    folder.mkdir(parents=True)
    for n in range(7):
        rows = []
        for t in np.arange(0.0, 1260.0, 10.0):
            u, v = minutes.wind[min(max(int(t // 60.0) - 1, 0), 19)]
            wind = (-65.536,) * 3 if t == 300.0 else (v, -u, 0.0)
            ppm = minutes.ppm[min(max(int(t // 60.0) - 1, 0), 19), n]
            rows.append(" ".join(map(str, (t, 284.0, 101325.0, 7000.0, *wind, 338.0, ppm, 0.01))))
        head = [""] * 3 + ["01/01/2017  10:00:00.0000"] + [""] * 9 + ["Elapsedtime_sec Temp_K"]
        (folder / f"POS{n + 1}_rel99_processed.txt").write_text("\n".join(head + rows))
    found = open_path.read(folder, MADE)
    assert found.ppm == pytest.approx(minutes.ppm, rel=1e-6)
    assert found.wind == pytest.approx(minutes.wind, rel=1e-6)
    assert found.density == pytest.approx(0.688, abs=0.001)
    monkeypatch.setenv(VARIABLE, str(tmp_path))
    (folder / "POS7_rel99_processed.txt").unlink()
    with pytest.raises(MissingDataError, match="POS7_rel99"):
        open_path.of_release(1, MADE)


@pytest.mark.slow
@pytest.mark.usefixtures("taichi")
def test_simulated_lasers_read_the_closed_form():
    minutes = made(5)
    read, exact = (
        open_path.lasers(minutes, SOURCE, RATE),
        RATE * open_path.enhancements(minutes, SOURCE[None])[0],
    )
    assert read == pytest.approx(exact, rel=0.01, abs=0.01 * exact.max())
    assert np.linalg.norm(REFLECTORS - SENSOR, axis=1) == pytest.approx(
        [34.9, 64.9, 44.5, 98.0, 83.0, 58.3, 33.7], abs=0.1
    )
