"""Decision quantities of a run in its table, report and recording; a run without them has no such column."""

import numpy as np
import pytest
from record.recordings import column, entities

import taichi_plume as tp
from taichi_plume.agents.spiral import Spiral
from taichi_plume.execution.execute import RunError
from taichi_plume.files import run_tables
from taichi_plume.report import captions, page

pytestmark = [pytest.mark.usefixtures("taichi"), pytest.mark.slow]

SCENARIO = """
duration: 8
domain: {size: [4, 3], spacing: 0.1}
wind: {kind: uniform, velocity: [0.5, 0]}
gas: {kind: gaussian_plume, intensity: 0.1, sources: [{position: [0.5, 1.5], rate: 20 mg/s}]}
robots:
  - name: spirals
    count: 2
    start: {kind: positions, positions: [[1.0, 1.5], [2.0, 2.0]], heading_deg: 0}
    algorithm: {kind: spiral, minimum_ppm: 0.1, acquisition: 1.5 s, settle: 0, arms: [0.1, 0.1]}
    sensors: {gas: {kind: ideal}, wind: {kind: ideal}}
  - name: replaced
    count: 1
    start: {kind: positions, positions: [[3.0, 1.5]], heading_deg: 0}
    algorithm: {kind: random_walk}
    sensors: {gas: {kind: ideal}, wind: {kind: ideal}}
"""


class Still:
    def act(self, robots):
        robots.speed[:] = 0.0


@pytest.fixture(scope="module")
def run(taichi, tmp_path_factory):
    folder = tmp_path_factory.mktemp("decided")
    (folder / "decided.yaml").write_text(SCENARIO)
    return tp.simulate(folder / "decided.yaml", out=folder / "run")


def test_the_table_has_the_columns_of_the_runs_algorithms(run):
    table = run.robots
    spirals = table[table.group == "spirals"]
    others = table[table.group == "replaced"]
    names = [each.name for each in Spiral.DECISIONS]
    decided = run_tables.decisions(run_tables.schema_in(run.folder / "robots.parquet"))
    assert decided == [*names, "course", "segment_m"]
    assert others[names].isna().all(axis=None)
    assert spirals[["course", "segment_m"]].isna().all(axis=None)
    assert (others.segment_m > 0.0).any()
    for each in Spiral.DECISIONS:
        assert table.attrs["units"][each.name] == each.unit
        assert table.attrs["meanings"][each.name].startswith(each.meaning)
    one = spirals[spirals.robot == 0]
    assert one.index_hit.isna().any()
    rated = one[one.index_hit.notna()]
    assert set(rated.index_hit) == {0.0, 1.0}
    assert ((rated.proximity_index >= rated.index_needed) == (rated.index_hit == 1.0)).all()


def test_the_recording_plots_them(run):
    path = run.folder / "recording.rrd"
    t, values = column(path, "/decisions/index_hit/spirals-1", "Scalars:scalars")
    rows = run.robots.query("group == 'spirals' and robot == 1 and index_hit == index_hit")
    expected = dict(zip(rows.t.round(3), rows.index_hit, strict=True))
    assert len(t) > 10
    assert [value[0] for value in values] == [expected[round(at, 3)] for at in t]
    assert "/decisions/segment_m/replaced" in entities(path)


def test_the_report_draws_them(run):
    page.write(run)
    text = (run.folder / page.NAME).read_text(encoding="utf-8")
    assert captions.DECISIONS in text


def test_a_run_without_them_has_no_column(run, tmp_path):
    path = run.folder.parent / "decided.yaml"
    still = {f"robots.{n}.algorithm": tp.Own(Still) for n in range(2)}
    other = tp.simulate(path, overrides={**still, "duration": 1}, out=tmp_path / "run")
    assert run_tables.decisions(run_tables.schema_in(other.folder / "robots.parquet")) == []
    assert not any(entity.startswith("/decisions") for entity in entities(other.folder / "recording.rrd"))
    page.write(other)
    assert captions.DECISIONS not in (other.folder / page.NAME).read_text(encoding="utf-8")


class Turns:
    DECISIONS = (("misses", "1", "number of misses in a row"), ("turn_by", "rad", "angle to turn"))

    def __init__(self):
        self.misses, self.turn_by = 3, None

    def act(self, robots):
        self.turn_by = 0.5 * robots.t
        robots.turn_to(robots.heading + self.turn_by)


def test_own_classes_add_their_columns(run, tmp_path):
    """A column that a built-in algorithm has too must be the same; other names are of the class alone."""
    path = run.folder.parent / "decided.yaml"
    changes = {"robots.1.algorithm": tp.Own(Turns), "duration": 2}
    other = tp.simulate(path, overrides=changes, out=tmp_path / "run")
    table = other.robots
    own = table[table.group == "replaced"]
    first = own.t == own.t.min()
    assert (own.misses == 3).all()
    assert own.turn_by[first].isna().all()
    assert own.turn_by[~first].to_numpy() == pytest.approx(0.5 * own.t[~first].to_numpy())
    assert table.turn_by[table.group == "spirals"].isna().all()
    assert table.attrs["units"]["turn_by"] == "rad"
    assert "/decisions/turn_by/replaced" in entities(other.folder / "recording.rrd")
    clash = type("Clash", (Turns,), {"DECISIONS": (("misses", "s", "time of misses"),)})
    with pytest.raises(tp.ScenarioError, match="algorithm: DECISIONS has the name 'misses' of another"):
        tp.Simulation(path, overrides={"robots.1.algorithm": tp.Own(clash)})
    twice = type("Twice", (Turns,), {"DECISIONS": 2 * Turns.DECISIONS[1:]})
    lacks = type("Lacks", (Turns,), {"DECISIONS": (("lost", "s", "time since the last detection"),)})
    for wrong, what in ((twice, "Twice: has 'turn_by' twice"), (lacks, "Lacks has no attribute 'lost'")):
        with pytest.raises(RunError, match=what):
            tp.simulate(path, overrides={"robots.1.algorithm": tp.Own(wrong)}, out=tmp_path / what[:5])


def test_the_present_state_has_the_same_columns(run):
    with tp.Simulation(run.folder.parent / "decided.yaml") as sim:
        sim.run(until=5)
        last = run.robots.query("abs(t - 5) < 1e-6").reset_index(drop=True)
        now = sim.robots.reset_index(drop=True)
        assert list(now.columns) == list(last.columns)
        np.testing.assert_array_equal(now.proximity_index, last.proximity_index)
