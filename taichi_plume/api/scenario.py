"""Methods of `Scenario` that read, check, draw or write: the section itself is data, and knows none of these rooms.

`taichi_plume/__init__.py` imports this module with the first public name, so every scenario of a user has the methods.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from taichi_plume.files.disk import written_whole
from taichi_plume.guard.safe_open import as_path
from taichi_plume.scenario.checks import Check
from taichi_plume.scenario.loading import Overrides
from taichi_plume.scenario.readable_yaml import all_keys, own_keys
from taichi_plume.scenario.scenario import Scenario

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def from_file(cls: type[Scenario], path: str | Path, overrides: Overrides = ()) -> Scenario:
    """Return the scenario of a YAML file or the name of an example; overrides: as of `simulate`.

    The keys and their values are checked; what depends on several keys or on files is checked by `check` and before
    a run. Raises ScenarioError, with a line for each fault.

    >>> import taichi_plume as tp
    >>> scenario = tp.Scenario.from_file("casting_room", {"domain.spacing": "5 cm"})
    >>> scenario.domain.spacing
    0.05
    """
    from taichi_plume.assembly.preparation import read

    return read(path, overrides)


def from_dict(cls: type[Scenario], data: Mapping[str, object], folder: str | Path = ".") -> Scenario:
    """Return the scenario of a dict with the keys of a file, also with units, such as "5 cm"; see `from_file`.

    folder: folder of the files that it names.
    """
    from taichi_plume.assembly.preparation import read

    return read(data, folder=folder)


def to_yaml(scenario: Scenario, path: str | Path | None = None, defaults: bool = False) -> str:
    """Return the scenario as YAML with handy units: the keys that were set, or with `defaults` all keys.

    path: file to write it to as well, from which `from_file` returns an equal scenario; input files must lie in the
    same place relative to it. Raises OSError.
    """
    text = all_keys(scenario, exact=True) if defaults else own_keys(scenario, exact=True)
    if path is not None:
        with written_whole(as_path(path, "path")) as fresh:
            fresh.write_text(text, encoding="utf-8")
    return text


def check(scenario: Scenario, allow_outside: bool = False) -> Check:
    """Return errors, warnings, size and derived quantities, as printed by ``run --check``.

    allow_outside: whether files of the scenario may lie outside its folder.

    >>> import taichi_plume as tp
    >>> check = tp.Scenario.from_file("casting_room").with_({"robots.0.count": 3}).check()
    >>> bool(check), int(check.size["cells"])
    (True, 7500)
    """
    from taichi_plume.assembly import preparation

    return preparation.check(scenario, allow_outside)


def plot(
    scenario: Scenario,
    allow_outside: bool = False,
    *,
    ax: "Axes | None" = None,
    figsize: tuple[float, float] | None = None,
) -> "Figure":
    """Return a drawing of the scene, as by ``run --check``: from above and in 3-D also from the side.

    ax: axes of a figure of yours for the view from above; figsize: width and height of a new figure [inches].
    Raises ScenarioError if the scenario has errors, and InputError if the figure would be too small.
    """
    from taichi_plume.assembly.preparation import load
    from taichi_plume.report.scene import checked_figure
    from taichi_plume.report.theme import Place

    return checked_figure(load(scenario, (), allow_outside), place=Place.of(ax, figsize))


def notebook(scenario: Scenario) -> str:
    """Return HTML of a scenario: errors or derived quantities, warnings, and a drawing of the scene."""
    from taichi_plume.report.html import in_notebook
    from taichi_plume.report.theme import png

    found = check(scenario)
    rows: list[tuple[str, object]] = [(scenario.name, "scenario"), *found.derived.items()]
    rows += [("error", line) for line in found.errors] + [("unlikely", line) for line in found.warnings]
    return in_notebook(rows, picture=png(plot(scenario)) if found else b"")


for _name, _method in {
    "from_file": classmethod(from_file), "from_dict": classmethod(from_dict), "to_yaml": to_yaml, "check": check,
    "plot": plot, "_repr_html_": notebook,
}.items():  # fmt: skip
    setattr(Scenario, _name, _method)
