"""From a scenario with probes to its statistics: a meandering plume against its closed forms."""

from math import exp, sqrt

import numpy as np
import pytest

import taichi_plume as tp
from taichi_plume.cli import run
from taichi_plume.cli.statistics import main
from taichi_plume.scenario.species import SPECIES
from taichi_plume.validation.whiffs import Meander

pytestmark = [pytest.mark.usefixtures("taichi"), pytest.mark.slow]

PPM = SPECIES["ethanol"].ppm_per_density
SCENARIO = """
name: meander
seed: 4
duration: {duration}
tick: {tick}
domain: {{size: [{length}, 20], spacing: 1}}
wind: {{kind: uniform, velocity: [1, 0], gusts: {{intensity: 0.3, time: {time}}}}}
gas: {{kind: meandering, width_slope: {slope}, sources: [{{position: [0, 10], rate: 0.001, radius: 0.02}}]}}
probes:
  every: {every}
  start: {start}
  points:
{points}
"""


def made(folder, points, **keys):
    file = folder / "meander.yaml"
    file.write_text(SCENARIO.format(points="\n".join(f"    - {one}" for one in points), **keys))
    assert (
        run.main([str(file), "--out", str(folder / "run"), "--quiet", "--no-report", "--no-recording"]) == 0
    )
    return folder / "run"


def test_moments_presence_and_width(tmp_path):
    """Samples 18 s apart do not depend on one another: a plume's age and eight integral times of the gusts."""
    count, x = 1000, 3.0
    line = f"{{kind: line, name: across, start: [{x}, 7], end: [{x}, 13], count: 61}}"
    folder = made(
        tmp_path, [line], duration=18 * count, tick=1, every=18, length=12, time=1.0, slope=0.05, start=18
    )
    plume = Meander(length=12.0, intensity=0.3, time=1.0, slope=0.05)
    share = 0.1
    found = tp.statistics(folder, threshold=share * plume.peak(x) * PPM)
    points = found.points
    n = found.samples
    assert n == count
    y = points.y.to_numpy() - 10.0
    first, second, fourth = (np.array([plume.moment(x, v, p) * PPM**p for v in y]) for p in (1, 2, 4))
    gamma = np.array([plume.presence(x, v, share) for v in y])
    near = np.abs(y) < 2.0  # beyond, so few times have gas that means are not normal
    mean, square = points["mean"].to_numpy(), (points["rms"] ** 2 + points["mean"] ** 2).to_numpy()
    for reported, exact, variance in (
        (mean, first, second - first**2),
        (square, second, fourth - second**2),
        (points["intermittency"].to_numpy(), gamma, gamma * (1 - gamma)),
    ):
        errors = ((reported - exact) / np.sqrt(variance / n))[near]
        assert np.abs(errors).max() < 4.0
        assert 0.05 < np.sqrt((errors**2).mean()) < 2.0  # points of one air go together
    (profile,) = found.probes[0].profiles
    width = sqrt(plume.relative(x) ** 2 + plume.wander(x) ** 2)
    assert profile.gaussian is not None
    assert profile.gaussian.width == pytest.approx(width, rel=4 / sqrt(2 * n))
    assert profile.gaussian.centre - 10.0 == pytest.approx(0.0, abs=4 * width / sqrt(n))
    assert profile.gaussian.peak == pytest.approx(plume.moment(x, 0.0, 1) * PPM, rel=0.06)
    # independent samples have an integral time of half a step; noise up to its correlation's first zero adds to it
    assert (
        0.9 < found.probes[0].points["mean_error"][30] / (found.probes[0].points["rms"][30] / sqrt(n)) < 1.6
    )


def test_whiffs_and_blanks_of_first_returns(tmp_path):
    """T^-3/2 between the gusts' time and the plume's age, but for 0.065 (validation/whiffs.py)."""
    time, dt = 0.05, 0.1
    plume = Meander(length=50.0, intensity=0.3, time=time, slope=0.02)
    points, thresholds = [], []
    for x in (40.0, 45.0, 49.5):
        for n, level in enumerate((-0.6, 0.0, 0.6)):
            wander = plume.wander(x)
            points.append(f"{{kind: point, name: at{x:g}-{n}, at: [{x}, {10 + (2 + level) * wander}]}}")
            thresholds.append(plume.peak(x) * exp(-((2 * wander / plume.relative(x)) ** 2) / 2) * PPM)
    folder = made(
        tmp_path, points, duration=3000, tick=dt, every="step", length=50, time=time, slope=0.02, start=100
    )
    threshold = float(np.mean(thresholds))
    argv = [str(folder), "--threshold", str(threshold), "--range", "0.95", "20.05", "--no-page"]
    assert main([*argv, "--out", str(tmp_path / "out")]) == 0
    found = tp.statistics(folder, threshold=threshold, bounds=(0.95, 20.05))
    from taichi_plume.fluctuations.durations import CELANI, exponent, pooled

    for n in (0, 1):
        law = exponent(pooled([one.kinds[n].all for one in found.probes]), 0.95, 20.05)
        assert law is not None
        assert law.count > 300
        assert abs(law.value - CELANI) < 0.2
