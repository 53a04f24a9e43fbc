import made_study
import numpy as np
import pytest

from taichi_plume.studies import grid_refinement
from taichi_plume.studies.messages import Axis


@pytest.mark.parametrize("spacings", [(0.1, 0.2, 0.4), (0.1, 0.15, 0.3), (0.05, 0.06, 0.11, 0.4)])
@pytest.mark.parametrize("p", [0.5, 1.0, 2.0, 3.7])
def test_manufactured_values(spacings, p):
    """f = f0 + a h^p gives p and f0 back, whichever order they are given in."""
    h = np.array(spacings)
    found = grid_refinement.order(h[::-1], 3.0 - 1.7 * h[::-1] ** p)
    assert (found.order, found.extrapolated) == pytest.approx((p, 3.0), rel=1e-6)
    assert found.behaviour == "converges"
    assert found.index == pytest.approx(1.25 * 1.7 * h[0] ** p, rel=1e-6)  # safety times the true error


def test_worked_examples():
    """Celik et al. 2008, table 1: first column (unequal ratios, monotone) and third column (oscillating)."""
    found = grid_refinement.order([1.0, 1.5, 1.5 * 1.333], [6.063, 5.972, 5.863])
    assert found.order == pytest.approx(1.53, abs=0.01)
    assert found.extrapolated == pytest.approx(6.1685, abs=1e-3)
    assert found.index / 6.063 == pytest.approx(0.022, abs=1e-3)
    found = grid_refinement.order([1.0, 2.0, 4.0], [6.0042, 5.9624, 6.0909])
    assert found.order == pytest.approx(1.51, abs=0.12)
    assert found.behaviour == "oscillates"


@pytest.mark.parametrize(
    ("values", "behaviour"),
    [([1, 2, 2.5], "diverges"), ([1, 2, 1.5], "diverges"), ([1, 1, 2], "still"), ([1, np.nan, 2], "too few")],
)
def test_what_does_not_converge(values, behaviour):
    assert grid_refinement.order([1, 2, 4], values).behaviour == behaviour


@pytest.fixture
def results(tmp_path):
    axes = {"spacing": Axis("spacing", "m", True), "algorithm": Axis("algorithm", "", True)}
    points = [(h, a) for h in (0.4, 0.1, 0.2) for a in ("casting", "spiral")]
    reported = {"spacing": {"key": "domain.spacing"}, "algorithm": {"variants": {}}}
    plan = made_study.plan(axes, points, airs=6, kind="refinement", varied=reported)
    wobble = {one.air: n % 3 for n, one in enumerate(plan.requests)}

    def make(one):
        h, spiral = one.values["spacing"], one.values["algorithm"] == "spiral"
        time = (30 + 50 * h) if spiral else 40 - 20 * h**2
        rows = [made_study.trial(0, True, time + (0 if spiral else wobble[one.air]))]
        return made_study.record(one, rows, outcomes={"correlation": 1 - h**1.5, "error": None})

    return made_study.published(tmp_path, plan, made_study.records(plan, make))


def test_a_study_has_the_order_of_each_quantity(results):
    orders = results.orders()
    by = {(row["quantity"], row["algorithm"]): row for row in orders.to_dict("records")}
    assert by["time_with_failures_s", "spiral"]["order"] == pytest.approx(1.0)
    assert by["time_with_failures_s", "spiral"]["extrapolated"] == pytest.approx(30.0)
    assert by["correlation", "casting"]["order"] == pytest.approx(1.5)
    assert by["success", "casting"]["behaviour"] == "still"
    assert by["time_with_failures_s", "casting"]["chance"] is True
    assert "it may be chance" in by["time_with_failures_s", "casting"]["words"]
    assert by["time_with_failures_s", "spiral"]["words"].startswith("order 1.00, towards 30 s")
    assert list(by["correlation", "spiral"]["spacings"]) == [0.1, 0.2, 0.4]
