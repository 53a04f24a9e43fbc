"""Ids of runs, airs and structures: hashes of all keys that affect the result, in SI units with all defaults.

Ids do not depend on the order of keys, the written units or the paths of files, but on the content of files. Numbers
are rounded to 12 digits, so that 35 cm and 0.35 m give the same id.
"""

import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

from taichi_plume.engine.choice import chosen
from taichi_plume.files.manifest import digest
from taichi_plume.scenario.changes import changed
from taichi_plume.scenario.comparison import structure
from taichi_plume.scenario.input_files import input_files, read_for
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.studies.axes import DIGITS
from taichi_plume.studies.study_keys import SEEDS
from taichi_plume.version import __version__

HEX = 16  # digits of an id
OUTPUTS = ("name", "recording", "forces", "fields", "plumesim_log", "checkpoint")
"""Sections that affect only which files a run writes."""
EMPTY: Mapping[str, str] = MappingProxyType({})
OF_AIR = ("duration", "warm_up", "tick", "domain", "wind", "obstacles", "gas")
OF_WAKES = ("arena", "robots", "rivals")
"""Sections that affect the air as well if robots have wakes."""


class Ids(NamedTuple):
    """Hashes of a scenario without seeds, from which ids of runs and airs (realisations of flow and gas) follow."""

    scenario: str
    air: str
    structure: str
    air_by_chance: bool
    wakes: bool

    def shown(self) -> "Ids":
        """Return ids whose runs differ from the original runs, for playback of a less detailed film of flow and gas."""
        return self._replace(scenario=_hash([self.scenario, "shown"]))

    def run(self, seed: int, air_seed: int) -> str:
        """Return the id of a run with these seeds."""
        return _hash([self.scenario, seed, air_seed, __version__, chosen()])

    def air_of(self, seed: int, air_seed: int) -> str:
        """Return the id of the air (realisation of wind and gas) of a run with these seeds."""
        drawn = ([air_seed] if self.air_by_chance else []) + ([seed] if self.wakes else [])
        return _hash([self.air, *drawn, __version__, chosen()])


class Digests:
    """Cache of hashes of the input files that scenarios in a folder name. Each file is read once."""

    def __init__(self, folder: Path):
        self.folder = folder
        self._known: dict[Path, str] = {}

    def ids(
        self, scenario: Scenario, opened: Mapping[str, Sequence[Path]], classes: Mapping[str, str] = EMPTY
    ) -> Ids:
        """Return the hashes of a scenario and its input files. Raises OSError.

        opened: files by path of the key; classes: digests of classes that Python code gave, by path of the key.
        """
        data = scenario.model_dump(mode="json")
        read: dict[str, object] = {
            where: [self._of(file) for file in read_for(where, name, self.folder, opened)]
            for where, name in input_files(scenario)
        }
        read |= classes
        data = _rounded(changed(data, read))
        kinds = [structure(value) for key, value in scenario if key not in (*OUTPUTS, *SEEDS)]
        wakes = any(group.wake for group in scenario.robots)
        return Ids(
            _hash({key: value for key, value in data.items() if key not in (*OUTPUTS, *SEEDS)}),
            _hash({key: data[key] for key in (*OF_AIR, *(OF_WAKES if wakes else ()))}),
            # with files and classes: a worker outlives changes of files that it has read
            _hash([kinds, list(read.items())]),
            scenario.air_by_chance,
            wakes,
        )

    def _of(self, file: Path) -> str:
        if file not in self._known:
            self._known[file] = digest(file, chunks=True)["sha256"]
        return self._known[file]


def _hash(value: object) -> str:
    text = json.dumps(value, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()[:HEX]


def _rounded(value: Any) -> Any:
    if isinstance(value, float):
        return float(f"{value:.{DIGITS}g}") + 0.0  # -0.0 is 0.0
    if isinstance(value, dict):
        return {key: _rounded(part) for key, part in value.items()}
    return [_rounded(part) for part in value] if isinstance(value, list) else value
