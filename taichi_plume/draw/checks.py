"""Errors, warnings and size of a text, in the words of ``run --check``, each line with the object that it concerns."""

import re
from dataclasses import dataclass, field
from pathlib import Path

from taichi_plume.assembly.own_code import question
from taichi_plume.assembly.preparation import load
from taichi_plume.draw.document import data_of
from taichi_plume.guard.yaml_text import LineError
from taichi_plume.scenario.loading import NEEDS, ScenarioError
from taichi_plume.scenario.size import amounts, derived, estimate

_PATH = re.compile(r"[a-z_]+(\[\d+\])*(\.[a-z_0-9]+(\[\d+\])*)*")


@dataclass(frozen=True)
class Remark:
    """Line of the checks. path: of the key that it concerns; "" for the experiment or the text as a whole."""

    line: str
    is_error: bool

    @property
    def path(self) -> str:
        """Path of the key at the start of the line."""
        path = self.line.partition(": ")[0]
        return path if _PATH.fullmatch(path) else ""


@dataclass(frozen=True)
class Findings:
    """Result of the checks. size: as of `estimate`, and derived quantities by name; empty if there are errors.

    code: for each Python file that a run would execute, the words that ask for permission, and its SHA-256.
    """

    remarks: tuple[Remark, ...]
    size: dict[str, float] = field(default_factory=dict)
    derived: dict[str, str] = field(default_factory=dict)
    code: dict[str, str] = field(default_factory=dict)

    @property
    def sound(self) -> bool:
        """Whether the scenario can be run."""
        return not any(remark.is_error for remark in self.remarks)

    @property
    def amounts(self) -> str:
        """Cells, memory, disk and time of a run in one line; empty if unknown."""
        return f"{self.size['cells']:,.0f} cells, {amounts(self.size)}" if self.size else ""


def check(text: str, folder: Path, allow_outside: bool = False) -> Findings:
    """Check a text like ``run --check``; folder: of the files that it names. Executes no code."""
    try:
        data = data_of(text)
        if not data:
            raise ScenarioError([f"is empty; {NEEDS}"])
        scenario, resources = load(data, (), allow_outside, folder)
    except LineError as fault:
        return Findings((Remark(str(fault), True),))
    except ScenarioError as error:
        return Findings(tuple(Remark(line, True) for line in error.faults))
    code = {
        question(f"{where}.file: {file.path}", file.digest): file.digest
        for where, file in resources.code.items()
    }
    remarks = tuple(Remark(line, False) for line in resources.warnings)
    return Findings(remarks, estimate(scenario), dict(derived(scenario)), code)
