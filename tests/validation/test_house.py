"""Two checkouts side by side: what is counted in a tiny one."""

import pytest

from taichi_plume.validation.house import counted, main

pytestmark = pytest.mark.slow

FILES = {
    "taichi_plume/models.py": '''"""Two lines
of docstring."""
# a comment alone
from typing import Any

class Model: ...  # code with a comment

class Fan(Model): ...
class Strong(Fan):
    speed: Any

def own(x: Any):
    return isinstance(x, Fan)
''',
    "agents/use.py": """import models
from models import Fan, Strong

def asks(x):
    def inner():
        return hasattr(x, "a") or getattr(x, "b", None)
    match x:
        case Strong(): return 1
    return isinstance(x, models.Fan | Strong), isinstance(x, (int, Strong)), isinstance(x, str)
""",
    "tests/test_it.py": """import pytest

@pytest.mark.parametrize("n", range(3))
def test_numbers(n): ...

def test_other(): ...

def helper(): ...
""",
}


@pytest.fixture
def checkout(tmp_path):
    for name, text in FILES.items():
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)
    return tmp_path


def test_a_tiny_house(checkout):
    house = counted(checkout)
    wanted = {
        "taichi_plume/: files, lines": "1, 13",
        "agents/: files, lines": "1, 9",
        "without validation: lines of code": 7 + 8,
        "of docstrings": 2,
        "of comments alone": 1,
        "longest file": "13 taichi_plume/models.py",
        "longest function": "6 asks (agents/use.py)",
        "models of the vocabulary": 2,
        "isinstance on models outside their module": 3,  # the pattern, and two of the three that follow
        "getattr, hasattr": "1, 1",
        "Any": 2,
        "test functions": 2,
        "test cases": 4,
    }
    assert {title: house[title] for title in wanted} == wanted


def test_both_stand_side_by_side(checkout, capsys):
    assert main([str(checkout), str(checkout), "--no-cases"]) == 0
    rows = dict(line.strip("| ").split(" | ", 1) for line in capsys.readouterr().out.splitlines()[2:])
    assert rows["agents/: files, lines"] == "1, 9 | 1, 9"
    assert rows["getattr, hasattr"] == "1, 1 | 1, 1"
    assert rows["test cases"] == "- | -"
