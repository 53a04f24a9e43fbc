"""Check the scenarios of a study. Thousands of scenarios may name the same files; each file is opened once."""

from collections import OrderedDict
from dataclasses import replace
from pathlib import Path

from taichi_plume.assembly import file_checks
from taichi_plume.assembly.preparation import Prepared, prepare
from taichi_plume.assembly.resources import OPENERS
from taichi_plume.scenario import checks
from taichi_plume.scenario.algorithms import Own
from taichi_plume.scenario.gases import PlaybackGas
from taichi_plume.scenario.loading import ScenarioError
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.studies.given_classes import GivenClasses

MOST_CACHED = 16  # scenarios whose files stay in memory: films and meshes are large


class Checks:
    """Checks of scenarios whose files lie in `folder`, as by `prepare.checked`.

    The resources depend only on the sections that name files, the obstacles, the species and the domain. Only the first
    of several scenarios with equal such sections opens these files (meshes, films and the like). classes: those that
    Python code gave, pickled for the workers.
    """

    def __init__(self, folder: Path, allow_outside: bool):
        self.folder, self.allow_outside = folder, allow_outside
        self.classes = GivenClasses()
        self._known: OrderedDict[tuple[str, ...], Prepared] = OrderedDict()

    def checked(self, scenario: Scenario) -> Prepared:
        """Return the checked scenario, completed from its files, and the files. Raises ScenarioError."""
        faults = checks.early_errors(scenario)
        if not faults:
            prepared = self.prepared(scenario)
            faults = file_checks.errors(prepared.resources) + self.classes.errors(scenario)
            if not faults:
                return prepared
        raise ScenarioError(faults)

    def prepared(self, scenario: Scenario) -> Prepared:
        """Return the scenario, completed from its files, and the files, without other checks. Raises ScenarioError."""
        reads = _reads(scenario)
        known = self._known.get(reads)
        if known is None:
            known = prepare(scenario, self.folder, self.allow_outside)
            self._known[reads] = known
            if len(self._known) > MOST_CACHED:
                self._known.popitem(last=False)
            return known
        self._known.move_to_end(reads)
        played = {path: gas for path, gas in known.scenario.gases if isinstance(gas, PlaybackGas)}
        completed = scenario.with_gases(played)
        return Prepared(completed, replace(known.resources, scenario=completed))


def _reads(scenario: Scenario) -> tuple[str, ...]:
    """Return a cache key: JSON of all sections of a scenario that decide which files are read and how."""
    sections = [
        f"{path} {section.model_dump_json(exclude={'parameters'} if isinstance(section, Own) else None)}"
        for path, section in checks.every(scenario)
        if type(section) in OPENERS
    ]
    obstacles = [obstacle.model_dump_json() for obstacle in scenario.obstacles]
    species = [repr(getattr(gas, "species", None)) for _, gas in scenario.gases]
    return (scenario.domain.model_dump_json(), *obstacles, *species, *sections)
