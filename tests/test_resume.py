"""Runs that are cut off and resumed equal unbroken ones to the bit, whatever they are made of."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from scripts import read_result

from taichi_plume import __version__
from taichi_plume.cli import run
from taichi_plume.engine import ti
from taichi_plume.engine.choice import ENGINES, chosen
from taichi_plume.execution import checkpoint_reading
from taichi_plume.execution.outputs import scenario_digest
from taichi_plume.files import checkpoint, manifest
from taichi_plume.files.run_folder import RunFolderError
from taichi_plume.time_loop import TimeLoop
from tests.fuzz import bases

CHANGED = {
    "continuous": ("own", ["gas={kind: continuous, diffusivity: 0.01, sources: [{position: [0.5, 1.5], rate: 1e-6}]}"]),
    "gaussian_puff": (
        "own", ["gas={kind: gaussian_puff, diffusivity: 0.01, releases: [{position: [0.5, 1.5], mass: 1e-6}]}"]
    ),
    "ecoli": ("casting_room", ["robots.0.algorithm={kind: ecoli}"]),
    "filmed": ("casting_room", ["fields={rate: 2}"]),
    "background": ("casting_room", ["gas.background=3", "fields={rate: 2}"]),
    "other_air": ("puffs_arena", ["seed=3", "air_seed=4"]),
    "handover": ("puffs_arena", ["gas.initial_size=4.5 cm", "gas.convection=weno5"]),
    "heat_puffs": ("heated_room", ["wind.buoyancy.heat.heaters.0.power=2 kW"]),
    "moving_source": ("casting_room", ["gas.sources.0.motion={path: [[0.2, 0.9, 1.3], [0.9, 0.6, 1.6]]}"]),
    "moving_puffs": ("puffs_arena", ["gas.sources.0.motion={path: [[0.9, 1, 1.6]]}", "gas.sources.0.stop=0.8"]),
    "weno5": ("mixture", ["wind.convection=weno5", "wind.turbulence={kind: vreman}"]),
}  # fmt: skip
COVERED = {
    "whiffs",  # as mixture and probed
    "dapso_arena",  # as odor_mapping_dapso
    *(base for base, _ in CHANGED.values()),
}
NAMES = sorted({*(path.stem for path in bases.CONFIGS.glob("*.yaml")), *bases.SCENARIOS} - COVERED)
CASES = {name: (name, []) for name in NAMES} | CHANGED


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("resume")
    bases.make(path, warm_up=0.3)
    text = (path / "upwind.py").read_text()
    (path / "upwind.py").write_text(
        text.replace(
            "self.wanted = speed", "self.wanted = speed; self.rng = np.random.default_rng(1); self.n = 0"
        ).replace("= self.wanted", "= self.wanted * self.rng.random(); self.n += 1")
        + "\n    def state(self):\n        return {'n': self.n, 'rng': self.rng.bit_generator.state}\n"
        + "\n    def restore(self, state):\n        self.n = state['n']\n"
        + "        self.rng.bit_generator.state = state['rng']\n"
    )
    return path


def untimed(folder: Path) -> dict:
    return {
        key: value for key, value in read_result(folder).items() if key not in ("wall_s", "Mcell_steps_per_s")
    }


def content(folder: Path) -> dict[str, bytes]:
    return {str(file.relative_to(folder)): file.read_bytes() for file in folder.rglob("*") if file.is_file()}


def same(whole: Path, other: Path) -> None:
    assert untimed(whole) == untimed(other)
    names = {file.name for file in whole.iterdir()} - {".lock"}
    assert names == {file.name for file in other.iterdir()} - {".lock"}
    for name in names & {"robots.parquet", "forces.csv", "probes.parquet", "plume.pslog"}:
        assert (whole / name).read_bytes() == (other / name).read_bytes(), name
    for name in names & {"fields.zarr", "maps.zarr"}:
        assert content(whole / name) == content(other / name), name


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_a_killed_run_goes_on_to_the_bit(folder, tmp_path, monkeypatch, case):
    """Copy a run's folder within a time step, which is what a kill would leave, and resume the copy."""
    base, changes = CASES[case]
    rng = np.random.default_rng(sum(map(ord, case)))
    ticks = 40
    killed = int(rng.integers(8, ticks))
    options = ["--quiet", "--allow-code", *(["--no-recording"] if rng.random() < 0.7 else [])]
    sets = [f"--set={change}" for change in ("stop_early=false", "checkpoint={every: 0.7}", *changes)]
    command = [str(folder / f"{base}.yaml"), *options, f"--duration={0.1 * ticks}", *sets]
    if base not in ("plumesim_casting", "playback", "fluent", "film"):
        command.append("--set=tick=0.1")
    whole, broken = tmp_path / "whole", tmp_path / "broken"
    advance = TimeLoop.advance

    def left(sim: TimeLoop) -> None:
        advance(sim)
        if sim.tick == killed:
            shutil.copytree(whole, broken)

    with monkeypatch.context() as patched:
        patched.setattr(TimeLoop, "advance", left)
        assert run.main([*command, "--out", str(whole)]) == 0
    ti.reset()  # dozens of runs in one process have crashed in a kernel
    assert (broken / checkpoint.NAME).exists()
    assert read_result(broken)["status"] == "running"
    assert run.main(["--resume", str(broken), "--allow-code", "--allow-outside", "--quiet"]) == 0
    same(whole, broken)


def test_only_what_is_read_again_has_to_be_the_same(tmp_path):
    """Not the scenario that the run was made of; and links to its folder make no difference."""
    folder, read = tmp_path / "runs" / "a", tmp_path / "wind.csv"
    folder.mkdir(parents=True)
    read.write_text("1")
    inputs = manifest.digests(folder, [read])
    (tmp_path / "link").symlink_to(folder)
    checkpoint_reading.require_same(folder, inputs, [read])
    checkpoint_reading.require_same(tmp_path / "link", inputs, [tmp_path / "link" / ".." / ".." / "wind.csv"])
    read.write_text("2")
    with pytest.raises(RunFolderError, match=r"wind.csv: has changed"):
        checkpoint_reading.require_same(folder, inputs, [read])


def test_a_run_is_resumed_with_its_own_engine(tmp_path):
    """Another engine gives other last bits."""
    (tmp_path / "scenario.yaml").write_text("name: a")
    about = {"version": __version__, "scenario": scenario_digest(tmp_path)}
    checkpoint.write(tmp_path / checkpoint.NAME, about | {"engine": chosen()})
    assert checkpoint_reading.saved(tmp_path)["engine"] == chosen()
    other = next(name for name in ENGINES if name != chosen())
    checkpoint.write(tmp_path / checkpoint.NAME, about | {"engine": other})
    with pytest.raises(RunFolderError, match=f"computed with {other}; resume with --engine {other}"):
        checkpoint_reading.saved(tmp_path)


def test_a_checkpoint_of_another_version_is_named_as_such(tmp_path):
    """Versions before the choice of an engine name none."""
    for version, why in (
        ("0.1.0", f"is of version 0.1.0, this is {__version__}"),
        (__version__, "is no checkpoint"),
    ):
        checkpoint.write(tmp_path / checkpoint.NAME, {"version": version, "scenario": ""})
        with pytest.raises(RunFolderError, match=why):
            checkpoint_reading.saved(tmp_path)
