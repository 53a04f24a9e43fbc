"""Mobile-robot olfaction in one process: air flow, gas, robots, maps and a recording from one YAML file."""

import os
import sys

if (
    _module := sys.argv[:1] == ["-m"]
    and any(word.removeprefix("-m").split(".")[0] == __name__ for word in sys.orig_argv[1:])
) or os.path.basename("".join(sys.argv[:1])) == "taichi-plume":
    try:
        os.getcwd()
    except OSError:
        from taichi_plume.guard.terminal import say

        say("the working folder does not exist any more; cd to one that does", error=True)
        raise SystemExit(2) from None

# `python -m` imports modules from the working folder first: a module named yaml beside a scenario would be run.
# Remove that folder before any other import, unless the package itself is there.
if _module:
    _first, _package = (os.path.realpath(path) for path in (sys.path[0], f"{__path__[0]}/.."))
    if _first == os.path.realpath(".") != _package:
        del sys.path[0]

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from taichi_plume.version import __version__ as __version__

# In a checkout the packages solvers, agents and validation lie beside this folder; in a wheel, inside it.
if not (Path(__file__).parent / "solvers").is_dir():
    __path__.append(str(Path(__file__).parents[1]))

# Redirect a standard stream that the shell has closed (`>&-`) to the null device. Else the next opened file would get
# its number, and the output of libraries would go into that file.
for _number, _stream in enumerate(("stdin", "stdout", "stderr")):
    try:
        os.fstat(_number)
    except OSError:
        os.open(os.devnull, os.O_RDWR)  # the lowest free number
    if vars(sys)[_stream] is None:
        setattr(sys, _stream, open(os.devnull, "w" if _number else "r"))  # noqa: SIM115

# Before the first import of taichi or quadrants, here or elsewhere: print no banner, and send no report of version,
# platform and user to Taichi's makers. In a notebook both would announce that they collect what kernels print, and ask
# for it after each launch.
for _variable, _value in (
    ("ENABLE_TAICHI_HEADER_PRINT", "0"), ("TI_SKIP_VERSION_CHECK", "ON"), ("TI_ENABLE_PYBUF", "0"),
    ("ENABLE_QUADRANTS_HEADER_PRINT", "0"), ("QD_ENABLE_PYBUF", "0"),
):  # fmt: skip
    os.environ.setdefault(_variable, _value)
# Taichi aborts without a home, as in services and cron jobs. "/" is the home of users without an account.
if os.name == "posix" and not os.environ.keys() & {"HOME", "XDG_CACHE_HOME"}:
    _home = os.path.expanduser("~")
    os.environ["HOME"] = _home if os.path.isabs(_home) else "/"

if TYPE_CHECKING:
    from taichi_plume import envs
    from taichi_plume.agents.own_robots import Robots
    from taichi_plume.api.cite import cite
    from taichi_plume.api.contest import contest
    from taichi_plume.api.dispersion import dispersion
    from taichi_plume.api.export import export
    from taichi_plume.api.maps import maps
    from taichi_plume.api.own import Own
    from taichi_plume.api.picture import picture
    from taichi_plume.api.repair import repair
    from taichi_plume.api.simulate import simulate
    from taichi_plume.api.simulation import Simulation
    from taichi_plume.api.statistics import statistics
    from taichi_plume.api.study import study
    from taichi_plume.assembly.preparation import load_scenario
    from taichi_plume.contests.standings import Standings
    from taichi_plume.execution.execute import RunError
    from taichi_plume.files.run_folder import RunFolderError
    from taichi_plume.guard.input_error import InputError
    from taichi_plume.results.run import Run, open_run
    from taichi_plume.scenario.loading import ScenarioError
    from taichi_plume.scenario.scenario import Scenario
    from taichi_plume.studies.results import open_study
    from taichi_plume.time_loop import UnstableError

__all__ = [
    "InputError",
    "Own",
    "Robots",
    "Run",
    "RunError",
    "RunFolderError",
    "Scenario",
    "ScenarioError",
    "Simulation",
    "Standings",
    "UnstableError",
    "cite",
    "contest",
    "dispersion",
    "envs",
    "export",
    "load_scenario",
    "maps",
    "open_run",
    "open_study",
    "picture",
    "repair",
    "simulate",
    "statistics",
    "study",
]
_MODULES = {
    "InputError": "guard.input_error",
    "Own": "api.own",
    "Robots": "agents.own_robots",
    "Run": "results.run",
    "RunError": "execution.execute",
    "RunFolderError": "files.run_folder",
    "Scenario": "scenario.scenario",
    "ScenarioError": "scenario.loading",
    "Simulation": "api.simulation",
    "Standings": "contests.standings",
    "UnstableError": "time_loop",
    "cite": "api.cite",
    "contest": "api.contest",
    "dispersion": "api.dispersion",
    "export": "api.export",
    "load_scenario": "assembly.preparation",
    "maps": "api.maps",
    "open_run": "results.run",
    "open_study": "studies.results",
    "picture": "api.picture",
    "repair": "api.repair",
    "simulate": "api.simulate",
    "study": "api.study",
    "statistics": "api.statistics",
}


def __getattr__(name: str) -> object:
    """Import and return a public name of the package at its first use, so that `import taichi_plume` is fast."""
    if name == "envs":
        return import_module("taichi_plume.envs")
    if name not in _MODULES:
        raise AttributeError(f"module 'taichi_plume' has no attribute '{name}'")
    import_module("taichi_plume.api.scenario")  # attaches the methods of Scenario
    return getattr(import_module(f"taichi_plume.{_MODULES[name]}"), name)


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
