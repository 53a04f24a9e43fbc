import re
import shlex
from html.parser import HTMLParser
from pathlib import Path

import made_study
import numpy as np
import pytest
import small_study

from taichi_plume.cli.study import main
from taichi_plume.files.run_folder import RunFolderError
from taichi_plume.studies import page, tables
from taichi_plume.studies.messages import Axis
from taichi_plume.studies.plan import load_plan
from taichi_plume.studies.results import cost_words
from taichi_plume.studies.store import table_of
from taichi_plume.studies.tables import make_tables, planned

pytestmark = pytest.mark.slow

WICKED = "<script>alert(1)</script>\x1b[31m & {{ name }}"


class Read(HTMLParser):
    """Tags, addresses and texts of a page."""

    def __init__(self, html: str):
        super().__init__()
        self.tags, self.addresses, self.texts = [], [], []
        self.feed(html)
        self.text = " ".join(" ".join(self.texts).split())

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.addresses += [value for key, value in attrs if key in ("src", "href", "action", "data")]
        assert not [key for key, _ in attrs if key.startswith("on")]

    def handle_data(self, data):
        self.texts.append(data)


@pytest.fixture
def write(tmp_path):
    """The page of a plan and its records, read."""

    def make(plan, records) -> Read:
        made_study.published(tmp_path, plan, records)
        return Read(page.write(tmp_path).read_text(encoding="utf-8"))

    return make


def rate(values, rng):
    return float(np.clip(0.9 - 0.6 * values["speed"] + rng.normal(0, 0.1), 0, 1))


@pytest.fixture
def sweep():
    axes = {"speed": Axis("speed", "m/s", True), "algorithm": Axis("algorithm", "", True)}
    reported = {
        "speed": {"keys": ["wind.openings.0.speed", "robots.0.body.max_speed"]},
        "algorithm": {"variants": {"a": {"robots.0.algorithm": {}}}},
    }
    points = [(speed, name) for speed in (0.2, 0.6, 1.0) for name in ("casting", WICKED)]
    return made_study.plan(axes, points, airs=6, searches=2, varied=reported, base="arena.yaml", name=WICKED)


def test_a_page_says_what_was_varied_and_what_came_of_it(write, sweep, tmp_path):
    records = made_study.records(sweep, made_study.searches(0, rate, 2))
    records[3] = records[3]._replace(status="failed", message=WICKED, trials=[], outcomes={})
    read = write(sweep, records[:-2])
    assert "69 of 72 runs" in read.text
    assert "1 failed, 2 missing" in read.text
    assert "wind.openings.0.speed, robots.0.body.max_speed" in read.text
    assert re.search(r"\d+ % of 138 searches, 95 % interval \d+-\d+ % over 6 airs", read.text)
    assert "6 points, each in 6 airs with 2 runs in each: 72 runs. The base is arena.yaml." in read.text
    assert f"failed/{records[3].run}/scenario.yaml" in read.text
    assert "2 of 72 runs are missing" in read.text
    assert f"select * from '{tmp_path}/trials/**/*.parquet'" in read.text
    assert f"python -m taichi_plume.study study.yaml --out {tmp_path}" in read.text
    assert read.text.count("casting") > 6
    assert re.search(r"\d+ % \(\d+\u2011\d+\)", read.text)  # in the table of points, on one line
    assert "localisation error" not in read.text  # nobody declares, nor shares an arena
    assert "in one arena" not in read.text


def declaring(request):
    """Two searches of groups that share an arena: one declares, falsely in one air of two; one never does."""
    right = request.air_seed % 2 == 0
    declared = {
        "outcome": "declared" if right else "neither", "declarations": 1, "false_declarations": int(not right),
        "declared_time_s": 5.0, "localisation_error_m": 0.125 if right else 1.125, "shares_arena": True,
    }  # fmt: skip
    rows = [
        made_study.trial(0, right, **declared, group="a"),
        made_study.trial(0, group="b", shares_arena=True),
    ]
    return made_study.record(request, rows)


def test_declarations_are_reported_over_airs(write, sweep):
    """But for those of searches for nothing."""

    def make(request):
        rows = declaring(request).trials
        nothing = {**rows[0], "group": "c", "searched": False, "success": None, "outcome": None}
        return made_study.record(request, [*rows, {**nothing, "localisation_error_m": 9.0}])

    read = write(sweep, made_study.records(sweep, make))
    assert "declared rightly" in read.text
    sentence = r"localisation error .*0\.625 m, mean of 72 searches with a declaration, .*over 6 airs"
    assert re.search(sentence, read.text)
    assert "Groups of a run were in one arena here" in read.text


def test_nothing_of_a_study_gets_to_command_a_page(write, sweep):
    records = made_study.records(
        sweep, lambda one: made_study.record(one, status="failed", message=WICKED, trials=[])
    )
    read = write(sweep, records)
    assert not {"script", "link", "iframe", "object", "form", "base"} & set(read.tags)
    assert all(one.startswith(("#", "data:image/png;base64,")) for one in read.addresses)
    assert r"<script>alert(1)</script>\x1b[31m & {{ name }}" in read.text
    assert "\x1b" not in read.text


@pytest.mark.parametrize(
    ("plan", "trials", "said"),
    [
        (made_study.plan({}, [()], airs=2), [made_study.trial()], "all 100 % of 2 searches"),
        (made_study.plan({}, [()], airs=6), [], "0.5, mean of 6 runs, no interval: all 6 airs have the same result"),
        (
            made_study.plan({"speed": Axis("speed", "m/s", True)}, [(0.2,), (0.3,)], airs=4, by_chance=False),
            [made_study.trial(), made_study.trial(1, False)],
            "50 % of 16 searches, 95 % interval 28-72 % over the searches, as all have the same air",
        ),
        (
            made_study.plan({"speed": Axis("speed", "m/s", True)}, [(0.2,), (0.3,)], airs=1),
            [made_study.trial()],
            "no interval: it takes at least 3 airs, there is 1",
        ),
        (
            made_study.plan({"on": Axis("on", "", True)}, [(True,), (False,)], airs=1),
            [made_study.trial(0, None)],
            "2 of 2 runs",
        ),
    ],
)  # fmt: skip
def test_studies_of_any_shape_have_a_page(write, plan, trials, said):
    assert said in write(plan, made_study.records(plan, lambda one: made_study.record(one, trials))).text


def test_a_study_of_which_nothing_is_done_has_a_page(write, sweep):
    assert "0 of 72 runs" in write(sweep, []).text


def test_a_seed_as_an_axis_is_no_axis_of_the_points(write):
    """Its values are those of one point."""
    plan = made_study.plan({"draw": Axis("draw", "", False)}, [(7,), (8,), (9,), (10,), (11,), (12,)], airs=1)
    requests = tuple(one._replace(point=0) for one in plan.requests)
    plan.requests = requests
    read = write(plan, made_study.records(plan, made_study.searches(1, lambda values, rng: 0.5)))
    assert "1 point, each in 6 airs" in read.text
    assert "draw [" not in read.text


def test_large_studies_stay_small(write):
    """Axes that are drawn: dots and their mean; of many points the best and the worst."""
    axes = {name: Axis(name, "m", False) for name in ("speed", "b", "c")} | {"kind": Axis("kind", "", True)}
    rng = np.random.default_rng(0)
    points = [(*map(float, rng.uniform(0.1, 1, 3)), f"kind {n % 8}") for n in range(300)]
    plan = made_study.plan(axes, points, airs=5, name="large")
    read = write(plan, made_study.records(plan, made_study.searches(2, rate)))
    assert "Shown are the 20 best and the 10 worst of 300 points" in read.text
    assert read.tags.count("tr") < 120
    assert sum(map(len, read.addresses)) < 2e6
    assert read.tags.count("img") >= 4


@pytest.mark.parametrize("name", ["plan.parquet", "runs.parquet", "trials"])
def test_what_is_damaged_is_reported_in_a_line(write, sweep, tmp_path, name):
    write(sweep, made_study.records(sweep))
    path = tmp_path / name
    path = next(path.rglob("*.parquet")) if path.is_dir() else path
    path.write_bytes(path.read_bytes()[:200])
    with pytest.raises(RunFolderError, match="is damaged") as reported:
        page.write(tmp_path)
    assert "\n" not in str(reported.value)


def test_costs_leave_out_pauses(sweep):
    """Two workers, 18 runs of 2 s each, one after the other; an hour; the same again, by others."""
    records = []
    for n, one in enumerate(sweep.requests):
        later, turn = divmod(n, 36)
        record = made_study.record(one, [])
        begun = 1e9 + 3600 * later + 2.5 * (turn // 2)
        records.append(
            record._replace(cost=record.cost._replace(begun=begun, worker=f"w{later}{turn % 2}", compiled=1))
        )
    reported = dict(cost_words(make_tables(planned(sweep), table_of(records)).costs))
    assert reported["wall time"] == "89 s, in 2 stretches, pauses between them left out"
    assert reported["runs"] == "72; 2 s each, of which 500 ms beyond the simulation itself"
    assert reported["workers"] == "2; at work 81 % of the time"  # 36 s of 44.5 s
    assert reported["kernels compiled"] == "72"


def test_the_command_to_go_on_finds_the_study(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    case, out = Path("my room"), Path("my studies/a")
    case.mkdir()
    (out / "parts").mkdir(parents=True)
    tables.write_plan(out, load_plan(small_study.write(case)))
    tables.publish(out, lambda: table_of([]))
    text = Read(page.write(out).read_text(encoding="utf-8")).text
    command = re.search(r"python -m taichi_plume.study (study.yaml --out .*?) python", text)
    assert command
    monkeypatch.chdir(case)
    line = shlex.split(command[1])
    assert main([*line, "--check"]) == 0
    assert (Path(line[-1]) / "plan.parquet").is_file()
