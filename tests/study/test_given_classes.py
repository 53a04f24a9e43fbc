"""Classes that Python code gives to a study or a contest: their digests, what the folder holds, and their runs."""

import linecache
import subprocess
import sys
import threading
from itertools import count
from pathlib import Path
from typing import Any

import pytest
import tasks
from study_rooms import UNIFORM
from test_campaign import scheduler, worker

import taichi_plume as tp
from taichi_plume.contests.entrants import entrants
from taichi_plume.contests.execution import Choice, Contest, fixed, plans
from taichi_plume.files.own_class import CLASSES, OwnAlgorithmError
from taichi_plume.studies import given_classes
from taichi_plume.studies.given_classes import GivenClass, labels
from taichi_plume.studies.plan import Plan, load_plan
from taichi_plume.studies.task_execution import execute_task

CELL = """
import enum
import numpy as np

class Gait(enum.Enum):
    SLOW = 0.1
    FAST = 0.2

TABLE = {"speeds": np.linspace(0.0, 0.3, 4), "states": {"up", "down", "left"}}
FACTOR = 1.0

def scaled(speed):
    return FACTOR * speed * (speed not in {"alpha", "beta", "gamma", "delta"})

class Base:
    def __init__(self, speed=0.1):
        self.speed = speed

class Creep(Base):
    def __init__(self, speed=0.1):
        super().__init__(speed)

    def act(self, robots):
        chosen = [scaled(self.speed) for gait in Gait if gait is Gait.SLOW]
        robots.speed[:] = min(chosen[0], TABLE["speeds"].max())
"""
"""Text of a notebook's cell, or of a program."""
CELLS = count(1)
START = {"kind": "positions", "positions": [[1.5, 0.6]], "heading_deg": 0}
BASE: dict[str, Any] = UNIFORM | {
    "robots": [UNIFORM["robots"][0] | {"count": 1, "trials": 1, "start": START}],
    "duration": 1.0,
}


def typed(text: str = CELL) -> type:
    """The class `Creep` of a text that was typed into a notebook: no file holds it, and no module."""
    entered: dict[str, Any] = {"__name__": "__main__"}
    name = f"<cell {next(CELLS)}>"
    linecache.cache[name] = len(text), None, text.splitlines(keepends=True), name
    exec(compile(text, name, "exec"), entered)
    return entered["Creep"]


def study_of(*sections: dict[str, Any], **keys: Any) -> dict[str, Any]:
    axis = {"key": "robots.0.algorithm", "values": list(sections)}
    return {"name": "a", "base": BASE, "axes": {"algorithm": axis}, "airs": 1} | keys


def runs(plan: Plan) -> list[str]:
    return [request.run for request in plan.requests]


def test_the_digest_of_a_class_is_the_same_in_each_session(tmp_path):
    """With other hashes of texts, other random ids, other line numbers, and from compiled files."""
    program = CELL + "\nfrom taichi_plume.studies.given_classes import GivenClass\n"
    here, imported = (
        "print(GivenClass.of(Creep).digest)",
        "import cell; print(GivenClass.of(cell.Creep).digest)",
    )
    lines = {"a.py": program + here, "b.py": "\n# a remark\n\n" + program + here}
    lines |= {name: program + imported for name in ("c.py", "d.py")}
    (tmp_path / "cell.py").write_text(CELL)
    found = {}
    for seed, (name, text) in enumerate(lines.items()):
        (tmp_path / name).write_text(text)
        environment = {"PYTHONHASHSEED": str(seed), "PYTHONPATH": str(Path(__file__).parents[2])}
        command = [sys.executable, name]
        done = subprocess.run(
            command, capture_output=True, text=True, cwd=tmp_path, env=environment, check=True
        )
        found[name] = done.stdout
    assert found["a.py"] == found["b.py"]
    assert found["c.py"] == found["d.py"]


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("FACTOR = 1.0", "FACTOR = 2.0"),
        ("SLOW = 0.1", "SLOW = 0.15"),
        ('"delta"}', '"epsilon"}'),
        ('"left"}', '"right"}'),
        ("0.3, 4)", "0.3, 5)"),
        ("return FACTOR * speed", "return FACTOR + speed"),
        ("self.speed = speed", "self.speed = 2 * speed"),
        ("speed=0.1):\n        super", "speed=0.2):\n        super"),
        ("class Creep(Base):", "class Creep(Base):\n    MESSAGE = 1"),
        ("min(chosen[0]", "max(chosen[0]"),
    ],
)
def test_what_a_class_uses_is_part_of_its_digest(old, new):
    assert CELL.count(old) == 1
    known = GivenClass.of(typed()).digest
    assert GivenClass.of(typed("\n\n" + CELL)).digest == known
    assert GivenClass.of(typed(CELL.replace(old, new))).digest != known


def test_a_loop_of_references_ends():
    entered: dict[str, Any] = {}
    exec("class Loop:\n    def act(self, robots):\n        return Loop, items\nitems = [0]", entered)
    entered["items"].append(entered["items"])
    known = GivenClass.of(entered["Loop"]).digest
    entered["items"][0] = 1
    assert GivenClass.of(entered["Loop"]).digest != known


def test_runs_of_a_class_have_the_ids_of_what_it_does():
    """A cell that is executed again defines another class of the same name, which does the same."""
    first, again = typed(), typed()
    other = typed(CELL.replace("FACTOR = 1.0", "FACTOR = 2.0"))
    sections = [tp.Own(one) for one in (first, again, other)]
    assert len({section["name"] for section in sections}) == 3
    ids = [runs(load_plan(study_of(section))) for section in sections]
    assert ids[0] == ids[1] != ids[2]
    assert (
        load_plan(study_of(sections[0])).requests[0].structure
        != load_plan(study_of(sections[2])).requests[0].structure
    )
    assert runs(load_plan(study_of(tp.Own(first, speed=0.2)))) != ids[0]
    with pytest.raises(tp.ScenarioError, match=r"algorithm: Creep and Creep_2 are the same run"):
        load_plan(study_of(*sections[:2]))


def test_values_of_an_axis_are_named_by_their_classes():
    other = typed(CELL.replace("FACTOR = 1.0", "FACTOR = 2.0"))
    sections = [tp.Own(typed()), tp.Own(other), tp.Own(other, speed=0.2), {"kind": "casting"}]
    plan = load_plan(study_of(*sections))
    names = ["Creep", "Creep_2", "Creep_2(speed=0.2)", '{"kind": "casting"}']
    assert [request.values["algorithm"] for request in plan.requests] == names
    assert labels(sections[1:]) == ["Creep", "Creep(speed=0.2)", '{"kind": "casting"}']


def test_the_folder_holds_the_text_of_the_cell():
    one = tp.Own(typed())
    text = load_plan(study_of(one)).texts["classes.py"].decode()
    digest = GivenClass.of(CLASSES[str(one["name"])]).digest
    assert text.splitlines()[0] == f"# {one['name']}: class Creep, SHA-256 of what it does: {digest}"
    assert CELL in text
    assert "classes.py" not in load_plan(study_of({"kind": "casting"})).texts
    unknown = typed()
    linecache.cache.clear()
    assert "source text is not known" in load_plan(study_of(tp.Own(unknown))).texts["classes.py"].decode()


def test_what_cannot_be_sent_is_refused_before_anything_is_written(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    lock = threading.Lock()

    class Locked:
        def act(self, robots):
            with lock:
                pass

    for given, part in (
        (tp.Own(Locked), "Locked.*lock"),
        ({"kind": "own", "name": "Nobody"}, "file: FILE.py"),
    ):
        with pytest.raises(tp.ScenarioError, match=rf"robots\[0\]\.algorithm: .*{part}"):
            tp.study(study_of(given))
    with pytest.raises(tp.InputError, match=r"algorithms: .*Locked.*lock"):
        tp.contest([tp.Own(Locked)])
    with pytest.raises(tp.InputError, match=r"parameters\.ways.*list"):
        load_plan(study_of(tp.Own(typed(), ways=(1, 2))))
    assert not list(tmp_path.iterdir())


def test_a_class_for_another_python_is_not_loaded(monkeypatch):
    """Its compiled code could end the worker."""
    pickled = GivenClass.of(typed()).pickled
    monkeypatch.setattr(given_classes, "PYTHON", "cpython-399")
    with pytest.raises(OwnAlgorithmError, match=r"cpython-399.*cpython-3"):
        pickled.load()


def test_a_module_that_a_worker_lacks_fails_its_run_alone(tmp_path, monkeypatch):
    (tmp_path / "only_here.py").write_text("def speed():\n    return 0.1\n")
    monkeypatch.syspath_prepend(tmp_path)
    text = "import only_here\nclass Creep:\n    def act(self, robots):\n        robots.speed[:] = only_here.speed()\n"
    plan = load_plan(study_of(tp.Own(typed(text))))
    sys.modules.pop("only_here")
    sys.path.remove(str(tmp_path))
    task = tasks.task(plan.base, [plan.requests[0].changes], tmp_path, classes=plan.classes)
    (record,) = execute_task(task)
    assert record.status == "failed"
    assert "robots[0].algorithm: Creep: cannot be loaded" in record.message
    assert "only_here" in record.message


def test_a_class_takes_part_in_a_contest(tmp_path):
    class Stay:
        def act(self, robots):
            robots.speed[:] = 0.0

    class Sure(Stay):
        def act(self, robots):
            robots.declare(robots.reading > 9, robots.position)

    given: list[Any] = ["casting", tp.Own(Stay), tp.Own(Sure)]
    some = entrants(given, [])
    assert [(one.name, one.found) for one in some] == [
        ("casting", "reached"), ("Stay", "reached"), ("Sure", "reached"), ("Sure_declares", "declared"),
    ]  # fmt: skip
    (plan,) = plans(Contest(tmp_path / "out", (fixed("open_2d", 4, 3),), tuple(some), 2))
    assert {one.values["algorithm"] for one in plan.requests} == {one.name for one in some}
    assert len(set(runs(plan))) == 2 * len(some)
    assert {one.name for one in plan.classes.values()} == {"Stay", "Sure"}
    text = Choice([*given, tp.Own(Stay, a=[1])], quick=True, out=Path("a")).call()
    called = "tp.contest(['casting', tp.Own(Stay), tp.Own(Sure), tp.Own(Stay, a=[1])], quick=True, out='a')"
    assert text == called


def test_what_is_no_algorithm_is_refused(tmp_path):
    taken = type("casting", (), {"act": lambda *_: None})
    for given, part in (
        (tp.Own(taken), "casting; rename the class"),
        ({"kind": "casting"}, "taichi_plume.Own"),
        ({"kind": "own", "name": "Nobody"}, "no class or function was given"),
    ):
        with pytest.raises(tp.ScenarioError, match=part):
            entrants([given], [])


def test_an_error_in_a_class_is_where_its_text_is(tmp_path):
    algorithm = typed(CELL.replace("        chosen =", "        robots.nowhere\n        chosen ="))
    name = algorithm.act.__code__.co_filename  # type: ignore[attr-defined]
    line = 1 + CELL[: CELL.index("        chosen =")].count("\n")
    plan = load_plan(study_of(tp.Own(algorithm)))
    (record,) = execute_task(
        tasks.task(plan.base, [plan.requests[0].changes], tmp_path, classes=plan.classes)
    )
    assert record.message.startswith(f"{name}, line {line}: AttributeError")


@pytest.mark.slow
def test_a_study_of_a_class_goes_on_and_refuses_another(tmp_path):
    out, keep = tmp_path / "out", {"keep": ["robots.parquet"]}
    settings: dict[str, Any] = {"out": out, "workers": 1, "progress": False, "report": False}
    slow, fast = typed(), typed(CELL.replace("FACTOR = 1.0", "FACTOR = 2.0"))
    results = tp.study(study_of(tp.Own(slow), tp.Own(fast), **keep), **settings)
    assert results.runs().status.tolist() == ["completed"] * 2
    assert results.trials().algorithm.tolist() == ["Creep", "Creep_2"]
    for run, factor in zip(results.runs().run, (1.0, 2.0), strict=True):
        *_, last, end = tp.open_run(out / "kept" / run).robots.itertuples()
        assert end.x - last.x == pytest.approx(0.1 * factor * (end.t - last.t), rel=1e-4)
    assert CELL in (out / "classes.py").read_text()
    costs = results.costs()
    again = tp.study(study_of(tp.Own(typed()), tp.Own(fast), **keep), **settings)
    assert again.costs().equals(costs)
    with pytest.raises(tp.RunFolderError, match="another study"):
        tp.study(study_of(tp.Own(typed(CELL.replace("FACTOR = 1.0", "FACTOR = 3.0"))), **keep), **settings)


@pytest.mark.slow
def test_workers_of_a_scheduler_get_the_class(tmp_path):
    with scheduler(tmp_path) as (_, address), worker(tmp_path, address):
        results = tp.study(
            study_of(tp.Own(typed())), out=tmp_path / "out", scheduler=address, progress=False, report=False
        )
    assert results.runs().status.tolist() == ["completed"]


@pytest.mark.slow
def test_a_contest_of_a_class_has_standings(tmp_path):
    standings = tp.contest(
        ["random_walk", tp.Own(typed())], scenarios=["open_2d"], airs=1, searches=2, workers=1,
        out=tmp_path / "out", progress=False,
    )  # fmt: skip
    assert standings.table.algorithm.tolist() == ["random_walk", "Creep"]
    assert "tp.Own(Creep)" in (tmp_path / "out" / "contest.html").read_text()
