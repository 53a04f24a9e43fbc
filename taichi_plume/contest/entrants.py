"""Who takes part: every search algorithm of scenario/algorithms.py, and the user's own.

All of them have the robot, sensors, starts and airs of the scenario, and their own defaults. The one thing that they
are told is what its file says of the plume (`Fixed.told`): each gets those of the keys that it has. One robot searches,
of algorithms for teams `TEAM` of them. Those that can say where the source is take part twice: once as all others,
where it is found when a robot comes to it, and as NAME_declares, where it is found when a robot says so rightly with
its first word.
"""

import difflib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, get_args

from taichi_plume.contest.fixed import NAMES, Fixed
from taichi_plume.files.own_class import OwnAlgorithmError, OwnFile
from taichi_plume.guard.opening import unopenable
from taichi_plume.guard.terminal import LONGEST_VALUE, visible
from taichi_plume.scenario.algorithms import Algorithm
from taichi_plume.scenario.listening import AnyAlgorithm
from taichi_plume.scenario.loading import ScenarioError, read_mapping

FLOOR = "random_walk"
"""Whoever does no better has learnt nothing from the gas."""
BESIDE = (FLOOR, "dapso")
"""Kinds that search though they are of use for more than that."""
TEAM = 5  # robots of a swarm, as in Marjovi & Marques, ICRA 2014
TOLD_AS = {"minimum_ppm": "threshold_ppm"}
"""Keys of algorithms that mean what the contest tells under another name: SPIRAL's least index is a reading."""
FILES = ("own", "policy")
"""Kinds that need a file of the user's."""


class Entrant(NamedTuple):
    """One who takes part. section: its algorithm as a scenario has it, without what it is told; robots: of its team;
    found: when they have found a source, reached or declared.
    """

    name: str
    section: dict[str, Any]
    robots: int = 1
    found: str = "reached"

    def changes(self, scenario: Fixed) -> dict[str, Any]:
        """What it changes in a scenario of the contest, by paths."""
        return {
            "robots.0.algorithm": self.section | _told(kinds()[self.section["kind"]], scenario.told),
            "robots.0.count": self.robots,
            "robots.0.found": self.found,
            "stop_early": self.found == "reached",  # where all have said wrongly, the time counts as a whole
        }


def kinds() -> dict[str, type[AnyAlgorithm]]:
    """All kinds of algorithms that there are."""
    union, *_ = get_args(Algorithm)
    return {get_args(one.model_fields["kind"].annotation)[0]: one for one in get_args(union)}


def shipped() -> tuple[Entrant, ...]:
    """Those that take part by themselves, the floor last."""
    fit = {kind for kind, one in kinds().items() if (one.searches or kind in BESIDE) and not one.in_space}
    some = [kind for kind in kinds() if kind in fit and kind not in FILES]
    some.sort(key=lambda kind: kind == FLOOR)
    return tuple(Entrant(kind, {"kind": kind}, TEAM if kinds()[kind].talks else 1) for kind in some)


def _told(model: type[AnyAlgorithm], told: Mapping[str, float]) -> dict[str, float]:
    """Of what the contest tells, what an algorithm has a key for."""
    wanted = {key: TOLD_AS.get(key, key) for key in model.model_fields}
    return {key: told[name] for key, name in wanted.items() if name in told}


def own(path: Path) -> Entrant:
    """The algorithm in a Python file, which is looked at and not executed. Raises ScenarioError, in a line."""
    _require_open(path)
    try:
        OwnFile.read(path, None)
    except OwnAlgorithmError as error:
        raise ScenarioError([visible(error)]) from None
    return Entrant(path.stem, {"kind": "own", "file": str(path.resolve())})


def learnt(path: Path) -> Entrant:
    """A learnt policy: an ONNX file of the default observations and actions, or a scenario that has one.

    Of a scenario it is that of the first group of robots with a policy from a file. Raises ScenarioError, in a line.
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
    names: Sequence[str] | None, files: Sequence[Path], policies: Sequence[Path] = ()
) -> list[Entrant]:
    """Those who take part: of the shipped ones all, or those of some names; and the user's. Raises ScenarioError."""
    there = {one.name: one for one in shipped()}
    chosen = (
        [there[name] for name in known("algorithm", names, list(there))] if names else list(there.values())
    )
    some = [one for each in chosen for one in _both(each)]
    taken = {*kinds(), *(one.name for each in there.values() for one in _both(each))}
    for path, mine in [*((path, own(path)) for path in files), *((path, learnt(path)) for path in policies)]:
        for one in _both(mine):
            if one.name in taken:
                raise ScenarioError(
                    [
                        f"{visible(path)}: another algorithm of the contest is called {visible(one.name)}; "
                        "rename the file"
                    ]
                )
            some.append(one)
            taken.add(one.name)
    return some


def _both(one: Entrant) -> list[Entrant]:
    """An entrant, and if it can say where the source is, the same at its word."""
    return [one, *_by_its_word(one)]


def _by_its_word(one: Entrant) -> tuple[Entrant, ...]:
    """The same, whose word counts; none where it never says where the source is."""
    section = one.section
    if section["kind"] == "own":
        speaks = b".declare(" in OwnFile.read(Path(section["file"]), None).source
    elif section["kind"] == "policy":
        speaks = bool(section.get("declares"))
    else:
        speaks = kinds()[section["kind"]].model_validate(section).may_declare
    return (one._replace(name=f"{one.name}_declares", found="declared"),) if speaks else ()


def scenarios(names: Sequence[str] | None, unless: Sequence[str]) -> list[str]:
    """The names of scenarios, in the contest's order; `unless` any are given. Raises ScenarioError."""
    given = known("scenario", names, list(NAMES)) if names else list(unless)
    return [name for name in NAMES if name in given]


def known(what: str, names: Sequence[str], there: Sequence[str]) -> list[str]:
    """Names of which each is there, once. Raises ScenarioError with the near one."""
    for name in names:
        if name not in there:
            close = difflib.get_close_matches(name, there, n=1)
            meant = f"did you mean {close[0]}? " if close else ""
            raise ScenarioError(
                [f"{what} '{visible(name, LONGEST_VALUE)}': there is none of that name; {meant}"
                 f"there are {', '.join(there)}"]
            )  # fmt: skip
    return list(dict.fromkeys(names))
