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


def read_result(folder: Path) -> dict[str, Any]:
    """Content of a run's result.json."""
    return json.loads((folder / "result.json").read_text())
