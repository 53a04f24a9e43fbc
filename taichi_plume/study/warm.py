"""Keeps simulations from run to run in one process, so that only the first run of a structure compiles anything.

Taichi has places for 512 trees of fields and frees none of them but all at once: before they or the memory run out it
is started anew, and with it all simulations.
"""

import gc
import os
from collections import OrderedDict
from collections.abc import Hashable
from typing import Any, NamedTuple

import psutil
import taichi as ti
from taichi.lang import impl

from taichi_plume.assembly.assemble import build
from taichi_plume.assembly.prepare import Prepared
from taichi_plume.grid import kernels
from taichi_plume.simulation import Simulation
from taichi_plume.solvers.filmed import Reel

PLACES = 480  # of 512 for trees of fields; beyond them Taichi crashes
USUAL = 40  # trees of a simulation, until one has been seen; usually 16
MOST = 8  # simulations at a time
SHARE = (
    0.8  # of the machine's memory per core, by which this process may have grown when Taichi is started anew
)


class Kept(NamedTuple):
    """A simulation that can be reset, what it was made of, and the film that it shows, if it shows one."""

    prepared: Prepared
    sim: Simulation
    reel: Reel | None


class Warm:
    """The simulations of a process, by what makes one fit for other scenarios; the least recently used go first.

    Taichi runs on one thread: a machine is filled by several processes. begun: how often Taichi has been started.
    """

    def __init__(self, most: int = MOST):
        self.most = most
        self.begun = 0
        self.backend = ""
        self._kept: OrderedDict[Hashable, Kept] = OrderedDict()
        self._program: Any = None
        self._largest = USUAL
        self._memory = 0
        self._compiled = 0

    @property
    def compiled(self) -> int:
        """Kernels compiled by this process so far."""
        return self._compiled + (kernels.compiled() if self._alive() else 0)

    def find(self, key: Hashable) -> Kept | None:
        """The simulation of that key, if there is one; to be reset."""
        if not self._alive():
            self._kept.clear()
        if key in self._kept:
            self._kept.move_to_end(key)
        return self._kept.get(key)

    def add(self, key: Hashable, prepared: Prepared, reel: Reel | None = None) -> Kept:
        """Assemble a simulation of a checked scenario whose code has been executed. Raises ScenarioError."""
        self._make_room()
        before = _trees()
        try:
            sim = build(prepared, reel=reel)
        finally:
            self._largest = max(self._largest, _trees() - before)
        self._kept[key] = Kept(prepared, sim, reel)
        return self._kept[key]

    def drop(self, key: Hashable) -> None:
        """Throw a simulation away, as something went wrong in it."""
        self._kept.pop(key, None)

    def _alive(self) -> bool:
        return self._program is not None and impl.get_runtime().prog is self._program

    def _make_room(self) -> None:
        """Start Taichi where it does not run, or anew where it has hardly a place, or much memory, left."""
        while len(self._kept) >= self.most:
            self._kept.popitem(last=False)
        if self._alive():
            grown = psutil.Process().memory_info().rss - self._memory
            allowed = SHARE * psutil.virtual_memory().total / (os.cpu_count() or 1)
            if _trees() + 1.5 * self._largest < PLACES and grown < allowed:
                return
            self._compiled += kernels.compiled()
        self._kept.clear()
        gc.collect()
        ti.reset()
        self.backend = kernels.start("cpu", threads=1)
        self._program = impl.get_runtime().prog
        self.begun += 1
        self._memory = psutil.Process().memory_info().rss


WARM = Warm()
"""Those of this process."""


def _trees() -> int:
    """How many trees of fields Taichi holds."""
    program: Any = impl.get_runtime().prog
    return program.get_snode_tree_size() if program else 0
