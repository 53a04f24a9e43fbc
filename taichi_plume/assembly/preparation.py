"""Loading and checking of a scenario with its files, each opened once: YAML -> Scenario -> Prepared -> checks."""

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from taichi_plume.assembly import file_checks
from taichi_plume.assembly.resources import OPENERS, Resources
from taichi_plume.files.bundled import file_or_example
from taichi_plume.files.conventions import FileFacts
from taichi_plume.grid.floor_plans import FloorPlan
from taichi_plume.grid.meshes import Solid
from taichi_plume.grid.shapes import ShapeError
from taichi_plume.guard.safe_open import as_path, gate
from taichi_plume.scenario import checks
from taichi_plume.scenario.checks import Check
from taichi_plume.scenario.input_files import given, input_files, strangers
from taichi_plume.scenario.loading import Overrides, ScenarioError, overridden, read_scenario
from taichi_plume.scenario.scenario import Origin, Scenario
from taichi_plume.scenario.shapes import shape
from taichi_plume.scenario.size import derived, estimate

Source = str | Path | Mapping[str, object] | Scenario
"""A scenario: path of its YAML file, name of an example, dict with the same keys, or the scenario itself."""


class Prepared(NamedTuple):
    """A checked scenario, completed with the species and sources of recorded gases, and its opened files."""

    scenario: Scenario
    resources: Resources


def check(source: Source, allow_outside: bool = False) -> Check:
    """Check a scenario, see `load`."""
    try:
        scenario, resources = load(source, (), allow_outside)
    except ScenarioError as error:
        return Check(error.faults, [], {}, {})
    return Check([], resources.warnings, estimate(scenario), dict(derived(scenario)))


def load_scenario(
    source: Source, overrides: Overrides = (), allow_outside: bool = False, folder: str | Path | None = None
) -> Scenario:
    """Return the checked scenario of a YAML file, an example or a dict with the same keys; no code is executed.

    source: path of the file, name of an example such as "casting_room", dict, or a `Scenario`. overrides: changes such
    as ``["robots.0.count=3"]`` or ``{"robots.0.count": 3}``. allow_outside: whether files may lie outside the
    scenario's folder; files named in overrides always may. folder: folder of the files that a dict names, by default
    the working folder. Raises ScenarioError, with a line for each fault.

    >>> import taichi_plume as tp
    >>> tp.load_scenario("casting_room", {"robots.0.count": 6}).robots[0].count
    6
    """
    return load(source, overrides, allow_outside, folder).scenario


def load(
    source: Source, overrides: Overrides = (), allow_outside: bool = False, folder: str | Path | None = None
) -> Prepared:
    """Load and check a scenario like `load_scenario`; return it with its opened files. Raises ScenarioError."""
    scenario = read(source, overrides, allow_outside, folder)
    origin = scenario.origin
    where = f"{origin.file}: " if origin.file and not isinstance(source, Scenario) else ""
    try:
        prepared = checked(scenario, origin.folder.resolve(), allow_outside, overridden(overrides))
    except ScenarioError as error:
        raise ScenarioError([f"{where}{line}" for line in error.faults]) from None
    prepared.resources.warnings[:0] = origin.notes
    prepared.resources.files["gaden"] = list(origin.gaden)
    return prepared


def read(
    source: Source, overrides: Overrides = (), allow_outside: bool = False, folder: str | Path | None = None
) -> Scenario:
    """Return a scenario like `load_scenario`, but without the checks that need its files or several sections.

    Of the scenario's files, only those of a GADEN project are opened. Raises ScenarioError.
    """
    if isinstance(source, str | Path):
        data: Path | Mapping[str, object] = file_or_example(source)
        origin = Origin(data.parent, data)
        if folder is not None:
            raise ScenarioError([f"folder: got {folder}; the files of a scenario lie beside its YAML file"])
    elif isinstance(source, Scenario):
        origin, data = source.origin, source.keys_set()
    elif isinstance(source, Mapping):
        origin, data = Origin(as_path(folder or ".", "folder")), source
    else:
        what = f"got {type(source).__name__}; give the path of a YAML file, the name of an example, or a dict"
        raise ScenarioError([f"scenario: {what}"])

    def expand(data: dict[str, Any]) -> dict[str, Any]:
        nonlocal origin
        whole, notes, files = expanded(data, origin.file or origin.folder / "scenario", allow_outside)
        if whole is not data:
            origin = origin._replace(notes=tuple(notes), gaden=tuple(files))
        return whole

    scenario = read_scenario(data, overrides, expand)
    return scenario.from_origin(origin)


def expanded(
    data: dict[str, Any], path: Path, allow_outside: bool = False
) -> tuple[dict[str, Any], list[str], list[Path]]:
    """Replace the key `gaden` of a scenario, if given, by the keys that describe the named GADEN project.

    Returns the keys, notes on settings that could not be converted, and the files read. Raises ScenarioError.
    """
    if data.get("gaden") is None:
        return data, [], []
    from taichi_plume.files import gaden_project

    folder = path.resolve().parent
    try:
        with gate(None if allow_outside else folder) as files:
            return *gaden_project.expanded(data, folder), files
    except ScenarioError as error:
        raise ScenarioError([f"{path}: {line}" for line in error.faults]) from None


def checked(
    scenario: Scenario,
    folder: Path,
    allow_outside: bool = False,
    named: Collection[str] = (),
    known: Prepared | None = None,
) -> Prepared:
    """Open the files of a scenario (see `prepare`), run all checks and return both. Raises ScenarioError."""
    _require_scenario(scenario)
    faults = checks.early_errors(scenario)
    if not faults:
        prepared = prepare(scenario, folder, allow_outside, named, known)
        faults = file_checks.errors(prepared.resources)
        if not faults:
            prepared.resources.warnings += file_checks.warnings(prepared.resources)
            return prepared
    raise ScenarioError(faults)


def _require_scenario(scenario: object) -> None:
    """Raise ScenarioError if the argument is no Scenario, such as a path or a dict."""
    if not isinstance(scenario, Scenario):
        what = f"got {type(scenario).__name__}; load_scenario returns the scenario of a YAML file or a dict"
        raise ScenarioError([f"scenario: {what}"])


def again(prepared: Prepared, scenario: Scenario) -> Prepared:
    """Check another scenario, with the same folder and permissions; files of sections that are equal stay open.

    Raises ScenarioError.
    """
    old = prepared.resources
    new = checked(scenario, old.folder, old.allow_outside, old.named, prepared)
    new.resources.allow_code = old.allow_code
    unchanged = {path for path, file in new.resources.code.items() if file == old.code.get(path)}
    new.resources.own |= {path: own for path, own in old.own.items() if path in unchanged}
    return new


def prepare(
    scenario: Scenario,
    folder: Path,
    allow_outside: bool = False,
    named: Collection[str] = (),
    known: Prepared | None = None,
) -> Prepared:
    """Open a scenario's files in `folder`; return both. Errors of unusable files are stored for the later checks.

    known: another scenario, whose files stay open for equal sections. Raises ScenarioError if a file lies outside
    `folder`, unless `allow_outside` is set or its key is in `named`.
    """
    faults = [] if allow_outside else strangers(scenario, folder, named)
    if faults:
        raise ScenarioError(faults)
    resources = Resources(scenario, folder, allow_outside, named)
    other = None if known is None else known.resources
    keys = [key for key, _ in input_files(scenario) if allow_outside or given(key, named)]
    free = {key.rpartition(".")[0] for key in keys}
    for n, obstacle in enumerate(scenario.obstacles):
        path = f"obstacles[{n}]"
        if resources.take_over(path, obstacle, other):
            continue
        try:
            with gate(None if path in free else folder) as resources.files[path]:
                found = resources.shapes[path] = shape(obstacle, scenario.domain, folder)
                if isinstance(found, FloorPlan | Solid):
                    resources.facts[path] = FileFacts(found.text, found.remarks)
        except ShapeError as error:
            resources.faults[path] = str(error)
    for path, section in checks.every(scenario):
        opener = OPENERS.get(type(section))
        if opener is not None and not resources.take_over(path, section, other):
            with gate(None if path in free else folder) as resources.files[path]:
                gas = opener(resources, path, section, folder)
            if gas is not None:
                resources.gases[path] = gas
    resources.scenario = scenario.with_gases(resources.gases)
    return Prepared(resources.scenario, resources)
