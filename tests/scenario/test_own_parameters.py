"""Parameters of users' algorithms: written and read again as equal values of equal types, or refused at load."""

import datetime
import random
from collections import OrderedDict
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from taichi_plume import Scenario
from taichi_plume.cli import run
from taichi_plume.files.run_folder import to_yaml, write_scenario
from taichi_plume.guard.yaml_text import parse
from taichi_plume.scenario.loading import ScenarioError, read_scenario
from taichi_plume.studies.plan import load_plan

BASE: dict[str, Any] = {
    "duration": 1,
    "domain": {"size": [4, 3], "spacing": 0.1},
    "wind": {"kind": "uniform", "velocity": [0.5, 0]},
    "gas": {"kind": "eulerian", "sources": [{"position": [0.5, 1.5], "rate": "1 mg/s"}]},
}
GROUP: dict[str, Any] = {"count": 1, "start": {"kind": "positions", "positions": [[3, 1]]}}
PATH = "robots.0.algorithm.parameters"


def scenario(**parameters: Any) -> Scenario:
    algorithm = {"kind": "own", "file": "a.py", "parameters": parameters}
    return Scenario.from_dict(BASE | {"robots": [GROUP | {"algorithm": algorithm}]})


def parameters(of: Scenario) -> Any:
    return vars(of.robots[0].algorithm)["parameters"]


def typed(value: Any) -> Any:
    """A value with its types, and its floats to the bit: 1, 1.0, True and -0.0 differ."""
    if isinstance(value, dict):
        return [(key, typed(part)) for key, part in value.items()]
    if isinstance(value, list):
        return [type(value), *map(typed, value)]
    return type(value), value.hex() if isinstance(value, float) else value


TEXTS = [
    "null",
    "~",
    "true",
    "yes",
    "1",
    "1.0",
    "1e3",
    "1_000",
    "0x1f",
    "0o7",
    "12:30:00",
    "2024-01-31",
    ".nan",
    ".inf",
]
TEXTS += [
    "<<",
    "=",
    *"-?:,[]{}#&*!|>%@`'\"",
    "",
    " ",
    " a ",
    "a\nb",
    "\n",
    "a\n\n b\n",
    "\t",
    "a: b",
    "a #b",
    "\\n",
]
TEXTS += ["é", "日本", "🙂", "x" * 200, "word " * 60]
FLOATS = [0.1 + 0.2, -0.0, 1.0, 1e300, 3e-308, 1e16, 1 / 3]  # Taichi flushes smaller ones to zero


def made(rng: random.Random, depth: int = 0) -> Any:
    kind = rng.randrange(9 if depth < 4 else 6)
    if kind == 0:
        return rng.choice([None, True, False])
    if kind == 1:
        return rng.choice([0, 1, -1, 2**63, -(10 ** rng.randrange(990)), rng.randrange(1000)])
    if kind == 2:
        return rng.choice([*FLOATS, rng.gauss(0, 1) * 10.0 ** rng.randrange(-300, 300)])
    if kind in (3, 4):
        return rng.choice(TEXTS)
    if kind == 5:
        return "".join(rng.choice("ab: #'\"\n\\{}[],&*!|>%@`-?é🙂\t ") for _ in range(rng.randrange(130)))
    if kind == 6:
        return [made(rng, depth + 1) for _ in range(rng.randrange(4))]
    return {rng.choice(TEXTS): made(rng, depth + 1) for _ in range(rng.randrange(4))}


@pytest.mark.parametrize("seed", range(60))
def test_parameters_are_read_again_as_they_were(tmp_path, seed):
    """From the scenario.yaml of a run, from the user's own file, and through changes of other keys."""
    rng = random.Random(seed)
    given = {f"p{n}": made(rng) for n in range(12)}
    whole = scenario(**given)
    assert typed(parameters(whole)) == typed(given)
    write_scenario(tmp_path, whole, tmp_path, "cpu")
    again = read_scenario(tmp_path / "scenario.yaml")
    assert typed(parameters(again)) == typed(given)
    assert to_yaml(again) == to_yaml(whole)
    for defaults in (False, True):
        whole.to_yaml(tmp_path / "own.yaml", defaults)
        assert typed(parameters(Scenario.from_file(tmp_path / "own.yaml"))) == typed(given)
    assert typed(parameters(again.with_({"seed": 3}))) == typed(given)


def test_numbers_are_written_to_the_last_bit(tmp_path):
    length = 0.1 + 0.2
    whole = scenario().with_({"robots.0.reach": length, "gas.sources.0.rate": 1e-6 / 3})
    again = Scenario.from_file(_written(tmp_path, whole))
    assert again.robots[0].reach == length
    assert again.gas.sources[0].rate == 1e-6 / 3


def _written(folder: Path, whole: Scenario) -> Path:
    whole.to_yaml(folder / "own.yaml")
    return folder / "own.yaml"


class Unshowable:
    def __repr__(self) -> str:
        raise RuntimeError("no")


LOOP: list[Any] = []
LOOP.append(LOOP)
BAD: dict[str, tuple[Any, str]] = {
    "nan": (float("nan"), "got nan: must be a text, a finite number"),
    "inf": (-float("inf"), "got -inf: must be a text, a finite number"),
    "tuple": ((1, 2), "got (1, 2) of type tuple: must be"),
    "set": ({1}, "got {1} of type set: must be"),
    "date": (datetime.date(2024, 1, 31), "of type date: must be"),
    "bytes": (b"\xff", "got b'\\xff' of type bytes: must be"),
    "object": (object(), "of type object: must be"),
    "function": (len, "of type builtin_function_or_method: must be"),
    "generator": ((n for n in ()), "of type generator: must be"),
    "decimal": (Decimal("0.1"), "got Decimal('0.1') of type Decimal: must be"),
    "complex": (1j, "got 1j of type complex: must be"),
    "array": (np.zeros(2), "of type ndarray: must be"),
    "number of NumPy": (np.float64(1.0), "of type float64: must be"),
    "path": (Path("a"), "must be a text"),
    "mapping": (OrderedDict(a=1), "of type OrderedDict: must be"),
    "whole number": (10**5000, "a whole number of more than 1,000 digits"),
    "long text": ("x" * 10_001, "a text of 10,001 characters; at most 10,000 are taken"),
    "character": ("a\u202eb", r"got 'a\u202eb': has the character \u202e, which does not print"),
    "surrogate": ("\ud800", r"has the character \ud800, which does not print"),
    "key": ({1: 2}, "the key 1 must be a text"),
    "key of bytes": ({b"a": 2}, "the key b'a' must be a text"),
    "character of a key": ({"\x1b": 2}, r"has the character \x1b, which does not print"),
    "loop": (LOOP, "is nested deeper than 32 levels"),
    "unshowable": (Unshowable(), "of type Unshowable: must be"),
}


@pytest.mark.parametrize("name", BAD)
def test_what_cannot_be_written_as_it_is_is_refused(name):
    value, what = BAD[name]
    algorithm = {"kind": "own", "name": "A", "parameters": {"p": value}}
    axis = {"key": f"{PATH}.p", "values": [1, value]}
    deep = {"a": [0, {"b": value}]}
    for load, where in (
        (lambda: scenario(p=value), "robots[0].algorithm.parameters.p"),
        (lambda: scenario(p=deep), "robots[0].algorithm.parameters.p"),
        (lambda: scenario().with_({f"{PATH}.p": value}), f"{PATH}.p"),
        (lambda: scenario().with_({"robots.0.algorithm": algorithm}), f"{PATH}.p"),
        (lambda: scenario().robots[0].algorithm.model_copy(update={"parameters": {"p": value}}), "parameters.p"),
        (lambda: type(scenario().robots[0].algorithm)(**algorithm), ""),
        (lambda: load_plan({"name": "a", "base": scenario(), "axes": {"gain": axis}}), "axes.gain.values[1]"),
    ):  # fmt: skip
        with pytest.raises(ValueError if not where else ScenarioError) as caught:
            load()
        if where:
            (line,) = caught.value.faults
            assert line.replace("robots.0.", "robots[0].").startswith(
                where.replace("robots.0.", "robots[0].")
            )
            assert what in line
            assert line.isprintable()


def test_a_file_with_nan_is_refused_by_the_command(tmp_path, capsys):
    whole = scenario(p=1.5, q=[2.5])
    text = to_yaml(whole).replace("p: 1.5", "p: .nan").replace("[2.5]", "[2.5, {r: .inf}]")
    (tmp_path / "nan.yaml").write_text(text)
    assert run.main([str(tmp_path / "nan.yaml"), "--check"]) == 2
    reported = capsys.readouterr().err
    assert "robots[0].algorithm.parameters.p: got nan: must be" in reported
    assert "Traceback" not in reported
    (tmp_path / "good.yaml").write_text(to_yaml(whole))
    assert run.main([str(tmp_path / "good.yaml"), "--check", "--set", f"{PATH}.q.0=.inf"]) == 2
    assert "robots[0].algorithm.parameters.q[0]: got inf: must be" in capsys.readouterr().err


def test_the_levels_that_a_file_may_have_are_taken_and_no_more(tmp_path):
    for levels, fits in ((26, True), (27, False)):
        value: Any = 1
        for _ in range(levels):
            value = [value]
        if fits:
            again = read_scenario(_written(tmp_path, scenario(p=value)))
            assert parameters(again)["p"] == value
            assert parameters(scenario().with_({f"{PATH}.p": value}))["p"] == value
        else:
            for load in (lambda: scenario(p=value), lambda: scenario().with_({f"{PATH}.p": value})):
                with pytest.raises(ScenarioError, match="nested deeper than 32 levels"):
                    load()


def test_large_parameters_are_read_again_or_refused_at_once(tmp_path):
    """By the size of the file to which they are written: numbers, keys and letters of several bytes count."""
    for part in (10**900, "🙂" * 900, {"k" * 900: 1}):
        few, many = [part] * 300, [part] * 3000
        write_scenario(tmp_path, scenario(p=few), tmp_path, "cpu")
        assert parameters(read_scenario(tmp_path / "scenario.yaml"))["p"] == few
        with pytest.raises(ScenarioError, match="at most 100,000 are allowed"):
            scenario(p=many)


def test_values_of_python_elsewhere_are_converted_or_refused():
    """Tuples, arrays, ranges and paths are usual in Python, and have one meaning where a key has a type."""
    value = BASE | {"domain": {"size": np.array([4, 3]), "spacing": np.float32(0.5)}, "duration": np.int64(2)}
    whole = Scenario.from_dict(value).with_({"gas.sources.0.position": (1, 2)})
    assert (whole.domain.size, whole.domain.spacing, whole.duration) == ((4.0, 3.0), 0.5, 2.0)
    assert whole.gas.sources[0].position == (1.0, 2.0)
    axis = {"key": "gas.sources.0.position", "values": ((1, 1), np.array([2.0, 2.0]))}
    plan = load_plan({"name": "a", "base": whole, "axes": {"place": axis}})
    assert [request.changes["gas.sources[0].position"] for request in plan.requests[::5]] == [
        [1, 1],
        [2.0, 2.0],
    ]
    plan = load_plan(
        {"name": "a", "base": BASE | {"gas": whole.gas}, "axes": {"seed": {"key": "seed", "values": [1]}}}
    )
    assert read_scenario(parse(plan.texts["base.yaml"].decode())).gas == whole.gas
    for bad, what in ((10**5000, "of more than 1,000 digits"), (object(), "of type object: must be")):
        for load, where in (
            (lambda: Scenario.from_dict(BASE | {"duration": bad}), "duration"),
            (lambda: whole.with_({"duration": bad}), "duration"),
            (lambda: load_plan({"name": "a", "base": BASE | {"duration": bad}, "axes": {"a": axis}}), "duration"),
            (lambda: load_plan({"name": bad, "base": BASE, "axes": {}}), "name"),
        ):  # fmt: skip
            with pytest.raises(ScenarioError) as caught:
                load()
            assert caught.value.faults[0].startswith(f"{where}: ")
            assert what in caught.value.faults[0]
