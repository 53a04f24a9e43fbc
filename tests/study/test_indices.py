import made_study
import numpy as np
import pytest
from scipy.stats import qmc

from taichi_plume.files.run_folder import RunFolderError
from taichi_plume.studies import indices
from taichi_plume.studies.messages import Axis
from taichi_plume.studies.results import open_study

FIRST, TOTAL = (0.3139, 0.4424, 0.0), (0.5576, 0.4424, 0.2437)  # of Ishigami's function, in closed form


def ishigami(x: np.ndarray) -> np.ndarray:
    return np.sin(x[..., 0]) + 7 * np.sin(x[..., 1]) ** 2 + 0.1 * x[..., 2] ** 4 * np.sin(x[..., 0])


def design(samples: int) -> np.ndarray:
    """Points in the order A, B, AB_0, AB_1, AB_2, (5 samples, 3)."""
    drawn = qmc.scale(qmc.Sobol(6, rng=1).random(samples), [-np.pi] * 6, [np.pi] * 6)
    a, b = drawn[:, :3], drawn[:, 3:]
    mixed = [np.where(np.arange(3) == n, b, a) for n in range(3)]
    return np.concatenate([a, b, *mixed])


def test_ishigami():
    """Its variance has a closed form (Ishigami & Homma 1990, doi:10.1109/ISUMA.1990.151285)."""
    samples = 4096
    used, reported = indices.sobol(ishigami(design(samples)), ("x", "y", "z"), samples)
    assert used == samples
    assert [one.first for one in reported.values()] == pytest.approx(FIRST, abs=0.02)
    assert [one.total for one in reported.values()] == pytest.approx(TOTAL, abs=0.02)
    for one, first, total in zip(reported.values(), FIRST, TOTAL, strict=True):
        assert one.first_low - 0.02 <= first <= one.first_high + 0.02
        assert one.total_low - 0.02 <= total <= one.total_high + 0.02
        assert one.total_high - one.total_low < 0.15


def test_what_is_missing_is_left_out_and_not_filled():
    samples = 512
    values = ishigami(design(samples))
    values[samples + 3] = np.nan  # of B
    used, reported = indices.sobol(values, ("x", "y", "z"), samples)
    assert used == samples // 2
    assert [one.total for one in reported.values()] == pytest.approx(TOTAL, abs=0.1)
    assert indices.sobol(values, ("x", "y", "z"), samples) == (used, reported)  # the same again
    assert indices.sobol(np.full(5 * 8, np.nan), ("x", "y", "z"), 8) == (0, {})
    assert indices.sobol(np.full(5 * 8, 3.0), ("x", "y", "z"), 8) == (8, {})


def test_indices_are_shares_of_the_variance():
    """Estimates from 16 samples of noise reach from -0.2 to 1.6."""
    samples = 16
    values = np.random.default_rng(3).normal(size=5 * samples)
    _, reported = indices.sobol(values, ("x", "y", "z"), samples)
    found = np.array([list(one) for one in reported.values()])
    assert (found >= 0.0).all()
    assert (found <= 1.0).all()
    assert (found[:, 1] <= found[:, 0]).all()
    assert (found[:, 0] <= found[:, 2]).all()


def test_a_study_has_them(tmp_path):
    samples, names = 64, ("x", "y", "z")
    axes = {name: Axis(name, "", False) for name in names}
    points = design(samples)
    plan = made_study.plan(
        axes, [tuple(map(float, one)) for one in points], airs=3, kind="sensitivity", samples=samples
    )

    def make(one):
        value = float(ishigami(points[one.point]))
        time = 30 + value + (one.seed % 3 - 1) * 0.5
        return made_study.record(one, [made_study.trial(0, time=time)], outcomes={"correlation": value})

    records = made_study.records(plan, make)
    results = made_study.published(tmp_path, plan, records)
    frame = results.indices()
    times = frame[frame["quantity"] == "time_with_failures_s"].set_index("axis")
    runs = frame[frame["quantity"] == "correlation"].set_index("axis")
    used, reported = indices.sobol(ishigami(points), names, samples)
    for name in names:
        assert times.loc[name, "first"] == pytest.approx(reported[name].first, abs=1e-6)
        assert runs.loc[name, "total"] == pytest.approx(reported[name].total, abs=1e-6)
    assert used == times["used"].iloc[0] == samples
    assert times["noise"].iloc[0] == pytest.approx(0.25 / 3, rel=1e-3)  # means of airs 0.5 s apart
    assert "is chance from air to air" in times["words"].iloc[0]
    assert "success" not in set(frame["quantity"])  # all succeed: nothing varies
    made_study.add(tmp_path, records[:-6])
    frame = open_study(tmp_path).indices()
    assert set(frame["used"]) == {32}
    assert "32 of 64 rows of the design are used" in frame["words"][0]
    with pytest.raises(RunFolderError, match="is a study of kind sensitivity, not refinement"):
        results.orders()
