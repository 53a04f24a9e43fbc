"""Figures of the GPU benchmark in small."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from taichi_plume.engine.library import PREFIX

SEQUENCE = """
import json, sys
import numpy as np
from taichi_plume.validation.benchmark.gpu_rows import counting
with counting(sys.argv[1]) as count:
    import gpu_sequence as kernels
    from taichi_plume.engine import program, ti
    program.start(sys.argv[1])
    a = ti.field(ti.f32, 100)
    if sys.argv[2:]:
        kernels.sum_of(a)  # the cache's first kernel
    for _ in range(2):  # the second time, nothing is compiled
        count.clear()
        kernels.two_loops(a)
        kernels.two_loops(a)
        ti.sync()
        ti.sync()
        total = kernels.sum_of(a)
        kernels.add(a, np.ones(100, np.float32))
        count.collect()
kernels.two_loops(a)  # no longer counted
names = "launches", "tasks", "waits", "synchronisations", "numbers", "arrays", "by_kernel"
print(json.dumps({name: getattr(count, name) for name in names} | {"total": total}))
"""
KERNELS = """
from taichi_plume.engine import ti
from taichi_plume.engine.kernels import kernel
from taichi_plume.grid.kernels import Template

@kernel
def two_loops(a: Template):
    for i in range(100):
        a[i] = a[i] + 1.0
    for i in range(50):
        a[2 * i] = a[2 * i + 1] + 1.0

@kernel
def sum_of(a: Template) -> ti.f32:
    total = 0.0
    for i in range(100):
        total += a[i]
    return total

@kernel
def add(a: Template, b: ti.types.ndarray(ti.f32, 1)):
    for i in range(100):
        a[i] += b[i]
"""
SEQUENCE_COUNTS = {  # launches and tasks
    "gpu_sequence__two_loops_1": [2, 4],
    "gpu_sequence__sum_of_2": [1, 3],  # the loop, and a stretch of code before and after
    "gpu_sequence__add_3": [1, 1],
}


def counted(folder: Path, *arguments: str) -> dict:
    """Return the counts of the sequence, executed in a process of its own with a kernel cache in the folder."""
    (folder / "gpu_sequence.py").write_text(KERNELS)
    path = os.pathsep.join((str(folder), str(Path(__file__).parents[2])))
    cache = {f"{PREFIX}OFFLINE_CACHE_FILE_PATH": str(folder / "cache")}
    done = subprocess.run(
        [sys.executable, "-c", SEQUENCE, *arguments],
        env=os.environ | {"PYTHONPATH": path} | cache,
        capture_output=True,
        text=True,
    )
    if "no vulkan device" in done.stderr:
        pytest.skip("no device, not even Mesa's lavapipe")
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


def test_tasks_of_kernels_from_the_cache_are_counted_by_the_names_of_this_process(tmp_path):
    first = counted(tmp_path, "cpu", "sum first")
    assert first["by_kernel"]["gpu_sequence__sum_of_1"][:2] == [1, 3]
    again = counted(tmp_path, "cpu")
    assert {name: entry[:2] for name, entry in again["by_kernel"].items()} == SEQUENCE_COUNTS


@pytest.mark.parametrize("arch", ["cpu", "vulkan"])
def test_launches_tasks_and_waits_of_a_known_sequence_are_counted(arch, tmp_path):
    count = counted(tmp_path, arch)
    assert count["total"] == 550.0  # ones and twos, twice
    assert {name: entry[:2] for name, entry in count["by_kernel"].items()} == SEQUENCE_COUNTS
    assert (count["launches"], count["tasks"]) == (4, 8)
    assert (count["waits"], count["numbers"], count["arrays"]) == (
        3,
        1,
        1,
    )  # the second ti.sync waits for nothing
