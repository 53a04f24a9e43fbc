"""Kernels: launches, and the cache of compiled kernels on disk."""

import os
import re
import subprocess
import sys
import time
from functools import partial
from pathlib import Path
from types import FunctionType

import pytest

from taichi_plume.engine import program, ti
from taichi_plume.engine.conditions import name_in_source
from taichi_plume.engine.kernels import Instance
from taichi_plume.engine.library import CACHE_LOCK, NAME, PREFIX
from taichi_plume.grid import kernels, sweeps
from taichi_plume.grid.kernels import Pass, each, launch, together
from taichi_plume.grid.sweeps import flux_sweep, sweep

pytestmark = pytest.mark.usefixtures("taichi")


def test_every_launch_takes_its_own_numbers_and_runs_the_passes_in_order():
    seen = ti.field(ti.f32, (3, 2))
    count = ti.field(ti.i32, ())

    @ti.func
    def keep(a, b):
        seen[count[None], 0] = a
        seen[count[None], 1] = b

    @ti.func
    def go_on(a, b):
        count[None] += 1

    run = launch(Pass(keep, 1), Pass(go_on, 1))
    for numbers in ((1.5, -2.0), (), (3, 4)):
        run(*numbers)
    assert seen.to_numpy().tolist() == [[1.5, -2.0], [0.0, 0.0], [3.0, 4.0]]


@ti.func
def _add(out: ti.template(), n, a, b):
    out[n] = a + b


@ti.func
def _twice(I, a, b):
    return 2.0 * a + I[0]


@pytest.fixture
def named(monkeypatch):
    """Names of the kernels that are compiled in a test, without their numbers."""
    names, traced = [], Instance._traced

    def trace(instance, *arguments):
        names.append(instance.name.rpartition("_")[0])
        return traced(instance, *arguments)

    monkeypatch.setattr(Instance, "_traced", trace)
    return names


@pytest.mark.parametrize("device", [False, True])
def test_kernels_of_passes_have_the_names_of_what_they_do_per_cell(device, named, monkeypatch):
    if device:  # passes that do not depend on each other are one loop there
        monkeypatch.setattr(kernels, "on_cpu", lambda: False)
        monkeypatch.setattr(sweeps, "on_cpu", lambda: False)
    out, other = (ti.field(ti.f32, 8) for _ in range(2))
    inflow = flux_sweep([partial(_add, out)] * 2, _twice, out, [(0, 8)] * 2)
    passes = [each(partial(_add, out), 8), sweep(_twice, other, [(0, 8)])]
    launch(*together(passes))(1.0, 2.0)
    assert named == ["test_kernels__add__twice"]
    assert out.to_numpy().tolist() == [3.0] * 8
    assert other.to_numpy().tolist() == [2.0 + n for n in range(8)]
    assert list(kernels._bodies(inflow.run)) == [_twice]


def test_names_of_kernels_are_short_and_identifiers():
    def named(*places):
        functions = [(lambda: 0).__code__.replace(co_filename=file, co_name=name) for file, name in places]
        return name_in_source(FunctionType(function, {}) for function in functions)

    assert named(("/a/flow.py", "net_inflow")) == "flow__net_inflow"
    assert named(*[("/a/ghosts.py", "_fill"), ("/a/flow.py", "slow")] * 3) == "ghosts__fill__flow__slow"
    assert named(*(("flow.py", f"f{n}") for n in range(3))) == "flow__f0__f1__f2"
    assert named(*(("flow.py", f"f{n}") for n in range(9))) == "flow__f0__f1__7_more"
    assert re.fullmatch("_2_plumes__+lambda_", named(("/a/2-plumes é.py", "<lambda>")))


def test_a_device_that_there_is_not_is_reported_before_anything_starts():
    with pytest.raises(RuntimeError, match="got 'abacus', allowed are auto, cpu, cuda, vulkan, metal"):
        program.start("abacus")


SWITCH, FOLDER = f"{PREFIX}OFFLINE_CACHE", f"{PREFIX}OFFLINE_CACHE_FILE_PATH"
CACHE = (SWITCH, FOLDER, "XDG_CACHE_HOME")
KERNELS = {"taichi": "kernels", "quadrants": "kernels_quadrants"}[NAME]


@pytest.fixture
def no_cache_variables(monkeypatch):
    for name in CACHE:
        monkeypatch.setenv(name, "")  # so that what is set in a test is taken back
        monkeypatch.delenv(name)
    return monkeypatch


@pytest.mark.skipif(sys.platform != "linux", reason="other platforms have other folders")
def test_kernels_have_a_folder_of_their_own_in_the_users_cache(no_cache_variables, tmp_path):
    no_cache_variables.setenv("HOME", str(tmp_path))
    assert program.cache_folder() == tmp_path / ".cache" / "taichi_plume" / KERNELS
    no_cache_variables.setenv("XDG_CACHE_HOME", "not/absolute")
    assert program.cache_folder() == tmp_path / ".cache" / "taichi_plume" / KERNELS
    no_cache_variables.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    assert program.cache_folder() == tmp_path / "cache" / "taichi_plume" / KERNELS
    no_cache_variables.setenv(FOLDER, str(tmp_path / "mine"))
    assert program.cache_folder() == tmp_path / "mine"


def test_a_cache_folder_that_cannot_be_written_is_noted_once_and_not_used(
    no_cache_variables, tmp_path, capsys
):
    (tmp_path / "file").write_text("")
    no_cache_variables.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    program._cache()
    note = capsys.readouterr().err
    assert note.count("\n") == 1
    assert str(tmp_path / "file") in note
    program._cache()
    assert capsys.readouterr().err == ""
    assert os.environ[SWITCH] == "0"
    assert Path(os.environ[FOLDER]).is_dir(), "Taichi crashes where it has to make it"


def test_a_lock_that_a_killed_process_left_goes(no_cache_variables, tmp_path):
    """With the lock Taichi would store no kernel any more, and every run would compile again."""
    no_cache_variables.setenv(FOLDER, str(tmp_path))
    lock = tmp_path / CACHE_LOCK
    lock.parent.mkdir(exist_ok=True)
    for age, stays in ((1.0, True), (3600.0, False)):
        lock.touch()
        then = time.time() - age
        os.utime(lock, (then, then))
        program._cache()
        assert lock.exists() == stays


KERNEL = """
import taichi_plume
from taichi_plume.engine import program
from taichi_plume.grid import kernels, sweeps
program.start()
from taichi_plume.engine import ti
field = ti.field(ti.i32, 2)
field.fill(3)
print(field[1])
"""


@pytest.mark.skipif(os.name != "posix", reason="homes are those of POSIX")
@pytest.mark.parametrize("home", [{}, {"HOME": "/dev/null/none"}, {"XDG_CACHE_HOME": "/dev/null"}])
def test_kernels_run_and_the_process_ends_well_without_a_home(home):
    rest = {name: value for name, value in os.environ.items() if name not in (*CACHE, "HOME")}
    command = [sys.executable, "-c", KERNEL]
    done = subprocess.run(command, env=rest | home, capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stdout) == (0, "3\n"), done.stderr


def test_kernels_that_a_process_compiled_are_stored_at_its_end(tmp_path):
    """Also while garbage that is no longer collected refers to the program of Taichi, as after a run."""
    code = "import gc, taichi_plume as tp; sim = tp.Simulation('gaussian'); sim.run(until=0.2); gc.freeze()"
    command = [sys.executable, "-c", code]
    stored = []
    for _ in range(2):
        subprocess.run(command, env=os.environ | {FOLDER: str(tmp_path)}, check=True)
        stored.append({file.name: file.stat().st_mtime_ns for file in tmp_path.rglob("T*.*c")})
    assert stored[0]
    assert stored[1] == stored[0]
