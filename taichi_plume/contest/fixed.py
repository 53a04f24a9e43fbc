"""The contest's fixed scenarios: files of this package, each a whole scenario that `taichi_plume.run` takes too.

A file's first lines say what it puts to the test. Its robots' algorithm names what searchers are told of the plume:
`threshold_ppm`, and `wind_speed` for those that believe in a plume model (see contest/entrants.py).
"""

from pathlib import Path
from typing import Any, NamedTuple

import yaml

from taichi_plume.scenario.loading import scenario_from
from taichi_plume.scenario.scenario import Scenario

FOLDER = Path(__file__).with_name("scenarios")
NAMES = ("open_2d", "open_3d", "meandering", "closed_room", "obstacles", "two_sources")
"""In the order in which they are run and told."""
QUICK = ("open_2d",)
"""Of `--quick`."""


class Fixed(NamedTuple):
    """A scenario of the contest. about: paragraphs of the file's head; data: as YAML has them."""

    name: str
    about: tuple[str, ...]
    data: dict[str, Any]

    @property
    def scenario(self) -> Scenario:
        """The scenario, checked by itself alone."""
        return scenario_from(self.data)

    @property
    def told(self) -> dict[str, float]:
        """What searchers are told of the plume, by the names of their keys."""
        algorithm = self.data["robots"][0]["algorithm"]
        return {key: value for key, value in algorithm.items() if key != "kind"}


def fixed(name: str, seed: int | None = None, searches: int | None = None) -> Fixed:
    """One of NAMES, with another seed and number of searches in each air where they are given."""
    text = (FOLDER / f"{name}.yaml").read_text(encoding="utf-8")
    data = yaml.safe_load(text)
    if seed is not None:
        data["seed"] = seed
    if searches is not None:
        data["robots"][0]["trials"] = searches
    return Fixed(name, _about(text), data)


def _about(text: str) -> tuple[str, ...]:
    """The comment at the head of a file, whose question is a paragraph of its own."""
    lines = []
    for line in text.splitlines():
        if not line.startswith("#"):
            break
        lines.append(line.removeprefix("#").strip())
    setting, _, question = " ".join(lines).partition("The question: ")
    return (setting.strip(), f"The question: {question.strip()}")
