"""How declarations are judged and counted, trial by trial and in summaries."""

import fake_run
import numpy as np
import pytest

from taichi_plume.agents.columns import COLUMNS
from taichi_plume.agents.groups import GroupRange
from taichi_plume.execution import result, summary
from taichi_plume.scenario.robots import Group
from taichi_plume.scoring import trials as scores
from taichi_plume.scoring.declarations import OUTCOMES, declared_outcomes, has_declared
from taichi_plume.studies.table_rows import trial_rows

pytestmark = pytest.mark.usefixtures("taichi")


START = {"kind": "area", "low": [3, 0.5], "high": [3.8, 2.5]}


def searchers(count: int, trials: int, begin: float = 0.0, algorithm="casting", found="reached"):
    """The first group of a swarm."""
    model = {"name": "team", "count": count, "trials": trials, "begin": begin, "start": START, "found": found}
    model = Group.model_validate(model | {"algorithm": {"kind": algorithm}})
    return GroupRange(0, "team", 0, count, trials, model)


def said_of(n: int) -> dict[str, np.ndarray]:
    """A snapshot of what n robots have said: nothing."""
    now = {column.key: column.zeros(n) for column in COLUMNS if "declar" in column.key}
    return now | {"declared_time": np.full(n, np.nan), "reached_time": np.full(n, np.nan)}


def at(*places):
    """Return the function of sources that stay at these places."""
    return lambda t: np.broadcast_to(np.reshape(places, (-1, 2)), (*np.shape(t), len(places), 2))


UNKNOWN = np.full(2, np.nan)  # rates of the sources [kg/s]


def test_strength_is_that_of_the_nearest_source():
    """Log error and interval of three declared rates; the fourth robot declares nothing."""
    now = said_of(4)
    now["declarations"][:3], now["false_declarations"][:3] = 1, 1
    now["declared_time"][:3] = 3.0
    now["declared_position"][:3] = [[1.1, 1.0], [4.0, 1.2], [1.0, 1.2]]
    now["declared_rate"][:3] = [[2e-6, 1e-6, 3e-6], [5e-6, 4e-6, 6e-6], [1e-6, 1e-7, 9e-7]]
    group = searchers(1, 4, algorithm="source_term")
    reported = declared_outcomes(group, now, at([1.0, 1.0], [4.0, 1.0]), np.array([1e-6, 1e-5]))
    errors = [np.log(2.0), np.log(2.0), 0.0, np.nan]
    assert reported["strength_error"] == pytest.approx(errors, abs=1e-6, nan_ok=True)
    assert reported["strength_covered"] == pytest.approx([1.0, 0.0, 0.0, np.nan], nan_ok=True)
    assert "strength_error" not in declared_outcomes(searchers(1, 4), now, at([1.0, 1.0]), UNKNOWN)


def test_a_declaration_is_the_first_right_one_or_the_last():
    """Teams of two, a source at (1, 1): right and wrong; two wrong; one wrong and the other there; nothing at all."""
    now = said_of(8)
    now["declarations"][:6] = [1, 3, 1, 1, 2, 0]
    now["false_declarations"][:6] = [0, 2, 1, 1, 2, 0]
    now["declared_time"][:5] = [9.0, 7.0, 4.0, 5.0, 6.0]
    now["declared_position"][:5] = [[1.0, 1.0], [1.0, 1.3], [2.0, 1.0], [1.0, 5.0], [1.0, 0.5]]
    now["reached_time"][[2, 5, 6]] = [8.0, 3.0, np.nan]
    reported = declared_outcomes(searchers(2, 4, begin=2.0), now, at([1.0, 1.0], [50.0, 50.0]), UNKNOWN)
    assert reported["outcome"] == ["declared", "reached", "reached", "neither"]
    assert reported["declared_time_s"] == pytest.approx([5.0, 3.0, 4.0, np.nan], nan_ok=True)
    assert reported["localisation_error_m"] == pytest.approx([0.3, 4.0, 0.5, np.nan], nan_ok=True)
    assert reported["declarations"] == [4, 2, 2, 0]
    assert reported["false_declarations"] == [2, 2, 2, 0]
    assert reported["reached_time_s"] == pytest.approx([np.nan, 6.0, 1.0, np.nan], nan_ok=True)
    nowhere = declared_outcomes(searchers(2, 4), now, at(), UNKNOWN)
    assert np.isnan(nowhere["localisation_error_m"]).all()


@pytest.mark.parametrize(("algorithm", "found"), [("own", "reached"), ("casting", "declared")])
def test_who_may_declare_and_has_not_has_none(algorithm, found):
    """Of others it is not known what they would have said."""
    group = searchers(1, 2, algorithm=algorithm, found=found)
    reported = declared_outcomes(group, said_of(2), at([1.0, 1.0]), UNKNOWN)
    assert (reported["declarations"], reported["false_declarations"]) == ([0, 0], [0, 0])
    assert not has_declared(reported)
    assert np.isnan(reported["localisation_error_m"] + reported["declared_time_s"]).all()


def test_shares_of_outcomes():
    trials = {name: [1.0] * 4 for name in ("time_s", "path_m", "overhead", "acquisitions", "hits", "bumps")}
    trials |= {
        "success": [True] * 4, "outcome": ["declared", "reached", "declared", "neither"], "declarations": [1, 0, 2, 1],
        "false_declarations": [0, 0, 1, 1], "declared_time_s": [3.0, None, 5.0, 7.0],
        "localisation_error_m": [0.1, None, 0.2, 0.9],
    }  # fmt: skip
    reported = scores.trial_summary(trials, 10.0)
    assert [reported[f"{name}_rate"]["mean"] for name in OUTCOMES] == [0.5, 0.25, 0.25]
    assert reported["localisation_error_m"]["mean"] == pytest.approx(0.4)
    assert reported["localisation_error_m"]["n"] == 3
    assert reported["declared_time_s"]["mean"] == pytest.approx(5.0)
    assert reported["false_declarations"]["mean"] == 0.5
    none = {"declarations": [None] * 4, "false_declarations": [None] * 4}
    silent = scores.trial_summary(trials | none, 10.0)
    assert silent["declared_rate"] == {"mean": None, "low": None, "high": None, "n": 0}


def run(says=(), robots=None, **changes):
    """A fake run in which a robot of the first trial says this."""
    own = {"name": "own", "count": 2, "trials": 2, "start": START, "algorithm": {"kind": "own"}}
    model = fake_run.scenario(2, duration=6, maps=[], robots=[own | one for one in robots or [{}]], **changes)
    sim = fake_run.simulation(model)
    sim.swarm.says = says
    sim.run()
    return sim


def lines(sim) -> dict[str, str]:
    return dict(summary.summary(result.result(sim, "completed", "", "cpu")))


def test_the_summary_tells_what_was_declared():
    wrong, right = (2.0, (1.0, 2.5), False), (3.0, (0.6, 1.2), True)
    assert "own declared" not in lines(run())
    reported = lines(run([wrong, right]))
    assert reported["own declared"] == (
        "rightly in 1 of 2 trials; in 0 more a robot reached a source, in 1 neither; localisation error 0.3 m; "
        "time to declare 3 s; 1 false declaration in all"
    )
    reported = lines(run([wrong], [{"trials": 1, "found": "declared"}]))
    assert reported["own declared"] == "falsely after 2.0 s, 1.08 m from a source; 1 false declaration"
    assert reported["own"].startswith("own, 0 of 2 robots found a source by declaring")


@pytest.mark.parametrize("rivals", [True, False])
def test_rows_of_studies_tell_their_group_and_who_was_there(rivals):
    casters = {"name": "casters", "count": 1, "algorithm": {"kind": "casting"}}
    sim = run([(2.0, (0.6, 1.0), True)], [{}, casters], rivals=rivals)
    rows = trial_rows(sim)
    assert [(row["group"], row["trial"]) for row in rows] == [
        (who, n) for who in ("own", "casters") for n in (0, 1)
    ]
    assert [row["outcome"] for row in rows] == ["declared", "neither", "neither", "neither"]
    assert [row["declarations"] for row in rows] == [1, 0, None, None]
    assert {row["shares_arena"] for row in rows} == {not rivals}
