"""Mobile-robot olfaction in one process: air flow, gas, robots, maps and a recording from one YAML file."""

import os
import sys

if (
    _module := sys.argv[:1] == ["-m"]
    and any(one.removeprefix("-m").split(".")[0] == __name__ for one in sys.orig_argv[1:])
) or os.path.basename("".join(sys.argv[:1])) == "taichi-plume":
    try:
        os.getcwd()
    except OSError:
        from taichi_plume.guard.terminal import say

        say("the working folder does not exist any more; cd to one that does", error=True)
        raise SystemExit(2) from None

# `python -m` looks for modules in the working folder first: a yaml.py that lies in the folder of a case would be run.
# Left out before any other import, unless the package itself is there.
if _module:
    _first, _package = (os.path.realpath(one) for one in (sys.path[0], f"{__path__[0]}/.."))
    if _first == os.path.realpath(".") != _package:
        del sys.path[0]

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

# In a checkout the packages solvers, agents and validation lie beside this folder; in a wheel, inside it.
if not (Path(__file__).parent / "solvers").is_dir():
    __path__.append(str(Path(__file__).parents[1]))

# A standard stream that the shell has closed (`>&-`) goes nowhere. Else the next file to be opened would get its
# number, and what libraries print would go into that file.
for _number, _stream in enumerate(("stdin", "stdout", "stderr")):
    try:
        os.fstat(_number)
    except OSError:
        os.open(os.devnull, os.O_RDWR)  # the lowest free number
    if getattr(sys, _stream) is None:
        setattr(sys, _stream, open(os.devnull, "w" if _number else "r"))  # noqa: SIM115

# Before the first import of taichi, here or elsewhere: no banner, and no report to its makers of version, platform and
# an id of this user.
os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "0")
os.environ.setdefault("TI_SKIP_VERSION_CHECK", "ON")
# Taichi aborts where it finds no home, as in services and cron jobs. "/" is the home of users without an account.
if os.name == "posix" and not os.environ.keys() & {"HOME", "XDG_CACHE_HOME"}:
    _home = os.path.expanduser("~")
    os.environ["HOME"] = _home if os.path.isabs(_home) else "/"

if TYPE_CHECKING:
    from taichi_plume.assembly.prepare import load_scenario
    from taichi_plume.files.run_folder import RunFolderError
    from taichi_plume.results.run import open_run
    from taichi_plume.scenario.scenario import Scenario
    from taichi_plume.simulation import Simulation

__version__ = "0.2.0.dev0"
__all__ = ["RunFolderError", "Scenario", "Simulation", "load_scenario", "open_run"]


def __getattr__(name: str) -> Any:
    """The public names, imported when first used: `import taichi_plume` alone is instant."""
    where = {
        "RunFolderError": "files.run_folder",
        "Scenario": "scenario.scenario",
        "Simulation": "simulation",
        "load_scenario": "assembly.prepare",
        "open_run": "results.run",
    }
    if name not in where:
        raise AttributeError(f"module 'taichi_plume' has no attribute '{name}'")
    return getattr(import_module(f"taichi_plume.{where[name]}"), name)
