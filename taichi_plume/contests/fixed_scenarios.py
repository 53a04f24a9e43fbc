"""Fixed scenarios of the contest: files of this package that `taichi_plume.run` can execute, too.

The first lines of a file state the purpose of the scenario. The section `algorithm` of the robots holds the facts of
the plume for all algorithms: `threshold_ppm`, and `wind_speed` for plume models (see contests/entrants.py).
"""

from itertools import takewhile
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from taichi_plume.scenario.loading import scenario_from
from taichi_plume.scenario.scenario import Scenario

FOLDER = Path(__file__).with_name("scenarios")
NAMES = ("open_2d", "open_3d", "meandering", "closed_room", "obstacles", "two_sources")
"""Names of the scenarios in the order of execution and of the tables."""
QUICK = ("open_2d",)
"""Scenarios of `--quick`."""


class Fixed(NamedTuple):
    """A scenario of the contest. about: paragraphs of the file's head comment; data: as parsed from YAML."""

    name: str
    about: tuple[str, ...]
    data: dict[str, Any]

    @property
    def scenario(self) -> Scenario:
        """The scenario, validated without opening the files that it names."""
        return scenario_from(self.data)

    @property
    def facts(self) -> dict[str, float]:
        """Facts of the plume that algorithms are given, by key."""
        algorithm = self.data["robots"][0]["algorithm"]
        return {key: value for key, value in algorithm.items() if key != "kind"}


def fixed(name: str, seed: int | None = None, searches: int | None = None) -> Fixed:
    """Read the scenario `name`, one of NAMES, from its file. seed, searches (number in each air) replace its values."""
    text = (FOLDER / f"{name}.yaml").read_text(encoding="utf-8")
    data = yaml.safe_load(text)
    if seed is not None:
        data["seed"] = seed
    if searches is not None:
        data["robots"][0]["trials"] = searches
    return Fixed(name, _about(text), data)


def _about(text: str) -> tuple[str, ...]:
    """Return the comment at the head of a file as two paragraphs: the setting and the question."""
    head = takewhile(lambda line: line.startswith("#"), text.splitlines())
    lines = [line.removeprefix("#").strip() for line in head]
    setting, _, question = " ".join(lines).partition("The question: ")
    return (setting.strip(), f"The question: {question.strip()}")
