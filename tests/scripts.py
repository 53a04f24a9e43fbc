"""Helpers that tests share: scripts of the documentation as modules, Python processes, results of runs."""

import importlib.util
import json
import os
import subprocess
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

ROOT = Path(__file__).parents[1]


def loaded(path: Path) -> ModuleType:
    """Import a script that is in no package."""
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def python(
    folder: Path, *arguments: str, environment: dict[str, str] | None = None
) -> "subprocess.CompletedProcess[str]":
    """Run Python with this checkout in a folder, to its end. environment: unless given, that of the tests."""
    command = [sys.executable, *arguments]
    env = (os.environ | {"PYTHONPATH": str(ROOT)}) if environment is None else environment
    return subprocess.run(command, capture_output=True, text=True, check=False, cwd=folder, env=env)


def refused(*line: str) -> object:
    """Exit code of a command line, whether the command returns the code or leaves with it."""
    from taichi_plume.__main__ import main

    try:
        return main([*line])
    except SystemExit as end:
        return end.code


def refusal(capsys: Any, *line: str) -> str:
    """Return the one line with which a command line is refused."""
    capsys.readouterr()
    assert refused(*line) == 2
    reported = capsys.readouterr()
    assert (reported.out, reported.err.count("\n")) == ("", 1)
    return reported.err


def read_result(folder: Path) -> dict[str, Any]:
    """Content of a run's result.json."""
    return json.loads((folder / "result.json").read_text())
