"""Entrants of a contest: every search algorithm of scenario/algorithms.py, and the user's algorithms.

All entrants have the robot, sensors, starts and airs of the scenario, and their own defaults. An algorithm is given
those facts of the plume that it has keys for. One robot searches, or `TEAM` robots of an algorithm for teams.
Algorithms that can declare the source take part twice: like all others, where a search succeeds when a robot reaches
the source, and as NAME_declares, where the first declaration must be right.
"""

import difflib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, get_args

from taichi_plume.files.own_class import CLASSES, NO_CLASS, OwnAlgorithmError, OwnFile
from taichi_plume.guard.safe_open import unopenable
from taichi_plume.guard.terminal import LONGEST_VALUE, visible
from taichi_plume.scenario.algorithms import Algorithm
from taichi_plume.scenario.changes import shown
from taichi_plume.scenario.loading import ScenarioError, read_mapping
from taichi_plume.scenario.search_algorithm import AnyAlgorithm
from taichi_plume.studies.given_classes import GivenClass, is_given, labels

FLOOR = "random_walk"
"""Baseline: an algorithm that is not better gains nothing from the gas."""
BESIDE = (FLOOR, "dapso")
"""Kinds that take part although they are no plain search algorithms."""
TEAM = 5  # robots of a swarm, as in Marjovi & Marques, ICRA 2014
FACT_OF_KEY = {"minimum_ppm": "threshold_ppm"}
"""Fact of the plume for a key of another name: `minimum_ppm` of SPIRAL is a threshold of readings."""
FILES = ("own", "policy")
"""Kinds that need a file of the user."""


class Entrant(NamedTuple):
    """Contest entrant. section: `algorithm` of the scenario without facts of the plume; robots: their number; found:
    "reached" or "declared", the event that ends a search.
    """

    name: str
    section: dict[str, Any]
    robots: int = 1
    found: str = "reached"

    def changes(self, facts: Mapping[str, float]) -> dict[str, Any]:
        """Return the changes to a scenario of the contest that let the entrant search, by path; facts: of the plume."""
        names = {key: FACT_OF_KEY.get(key, key) for key in kinds()[self.section["kind"]].model_fields}
        accepted = {key: facts[name] for key, name in names.items() if name in facts}
        return {
            "robots.0.algorithm": self.section | accepted,
            "robots.0.count": self.robots,
            "robots.0.found": self.found,
            "stop_early": self.found == "reached",  # after wrong declarations the whole time counts
        }


def kinds() -> dict[str, type[AnyAlgorithm]]:
    """Return the models (sections of a scenario) of all algorithms, by kind."""
    union, *_ = get_args(Algorithm)
    return {get_args(model.model_fields["kind"].annotation)[0]: model for model in get_args(union)}


def shipped() -> tuple[Entrant, ...]:
    """Return the entrants that ship with the package, the baseline last."""
    fit = {kind for kind, m in kinds().items() if m.searches or kind in BESIDE}
    names = [kind for kind in kinds() if kind in fit and kind not in FILES]
    names.sort(key=lambda kind: kind == FLOOR)
    return tuple(Entrant(kind, {"kind": kind}, TEAM if kinds()[kind].talks else 1) for kind in names)


def own(path: Path) -> Entrant:
    """Return the contest entrant of a user's Python file, which is read but not executed. Raises ScenarioError."""
    _require_open(path)
    try:
        OwnFile.read(path, None)
    except OwnAlgorithmError as error:
        raise ScenarioError([visible(error)]) from None
    return Entrant(path.stem, {"kind": "own", "file": str(path.resolve())})


def learnt(path: Path) -> Entrant:
    """Return a learnt policy: an ONNX file with default observations and actions, or the first policy of a scenario.

    Raises ScenarioError.
    """
    _require_open(path)
    if path.suffix.lower() == ".onnx":
        return Entrant(path.stem, {"kind": "policy", "file": str(path.resolve())})
    groups = read_mapping(path, "give an ONNX file, or a scenario whose robots run a policy").get("robots")
    for group in groups if isinstance(groups, list) else ():
        section = group.get("algorithm") if isinstance(group, dict) else None
        if (
            isinstance(section, dict)
            and section.get("kind") == "policy"
            and isinstance(section.get("file"), str)
        ):
            file = (path.parent / section["file"]).resolve()
            return Entrant(path.stem, section | {"file": str(file)})
    raise ScenarioError(
        [f"{visible(path)}: has no robots with algorithm: {{kind: policy, file: ...}}; give an ONNX file, or a "
         "scenario whose robots run a policy"]
    )  # fmt: skip


def _require_open(path: Path) -> None:
    fault = unopenable(path)
    if fault:
        raise ScenarioError([f"{visible(path)}: {fault}"])


def entrants(
    algorithms: Sequence[str | dict[str, Any]] | None, files: Sequence[Path], policies: Sequence[Path] = ()
) -> list[Entrant]:
    """Return the contest's entrants: shipped ones and the user's. Raises ScenarioError.

    algorithms: names of shipped ones and sections of classes (`taichi_plume.Own`); None for all shipped ones.
    """
    there = {entrant.name: entrant for entrant in shipped()}
    names = [name for name in algorithms or () if isinstance(name, str)]
    chosen = there if algorithms is None else known("algorithm", names, list(there))
    found = [both for name in chosen for both in _both(there[name])]
    taken = {*kinds(), *(both.name for entrant in there.values() for both in _both(entrant))}
    classes = [section for section in algorithms or () if not isinstance(section, str)]
    users = [(entrant.name, "class", entrant) for entrant in _of_classes(classes)]
    users += [(visible(path), "file", own(path)) for path in files]
    users += [(visible(path), "file", learnt(path)) for path in policies]
    for where, what, mine in users:
        for entrant in _both(mine):
            if entrant.name in taken:
                other = f"another algorithm of the contest is called {visible(entrant.name)}"
                raise ScenarioError([f"{where}: {other}; rename the {what}"])
            found.append(entrant)
            taken.add(entrant.name)
    return found


def _of_classes(sections: Sequence[dict[str, Any]]) -> list[Entrant]:
    """Return the entrants of classes that Python code gave. Raises ScenarioError for other sections."""
    for section in sections:
        if not is_given(section):
            raise ScenarioError(
                [f"algorithms: got {shown(section)}; give names, or classes by taichi_plume.Own"]
            )
    return [Entrant(name, section) for name, section in zip(labels(sections), sections, strict=True)]


def _both(base: Entrant) -> tuple[Entrant, ...]:
    """Return an entrant and, if the algorithm can declare the source, the variant judged by its declarations."""
    section = base.section
    if is_given(section):
        speaks = "declare" in _class_of(section).used
    elif section["kind"] == "own":
        speaks = b".declare(" in OwnFile.read(Path(section["file"]), None).source
    elif section["kind"] == "policy":
        speaks = bool(section.get("declares"))
    else:
        speaks = kinds()[section["kind"]].model_validate(section).may_declare
    return (base, base._replace(name=f"{base.name}_declares", found="declared")) if speaks else (base,)


def _class_of(section: dict[str, Any]) -> GivenClass:
    """Return the class of a section that Python code gave. Raises ScenarioError if other processes cannot have it."""
    try:
        code = CLASSES[section["name"]]
        if not isinstance(code, type):
            raise ScenarioError(
                [f"algorithms: {visible(section['name'])} is a function; give a class with the method act"]
            )
        return GivenClass.of(code)
    except KeyError:
        raise ScenarioError([f"algorithms: {shown(section)}: {NO_CLASS}"]) from None
    except OwnAlgorithmError as error:
        raise ScenarioError([f"algorithms: {error}"]) from None


def known(what: str, names: Sequence[str], there: Sequence[str]) -> list[str]:
    """Return the names without repetition. Raises ScenarioError for an unknown name, with a similar known name."""
    for name in names:
        if name not in there:
            close = difflib.get_close_matches(name, there, n=1)
            meant = f"did you mean {close[0]}? " if close else ""
            raise ScenarioError(
                [f"{what} '{visible(name, LONGEST_VALUE)}': there is none of that name; {meant}"
                 f"there are {', '.join(there)}"]
            )  # fmt: skip
    return list(dict.fromkeys(names))
