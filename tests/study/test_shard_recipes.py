"""Recipes of docs/howto/beyond_one_machine.md: each is executed, with a stand-in for a scheduler that is missing."""

import importlib.util
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pyarrow.parquet as pq
import pytest
import yaml

import taichi_plume as tp

ROOT = Path(str(tp.__file__)).parents[1]
PAGE = (ROOT / "docs" / "howto" / "beyond_one_machine.md").read_text(encoding="utf-8")
RECIPES = dict(re.findall(r"^```\{code-block\} \w+\n:caption: (\S+)\n\n(.*?)^```$", PAGE, re.M | re.S))
pytestmark = [pytest.mark.slow, pytest.mark.skipif(os.name == "nt", reason="shells")]

SBATCH = """#!/usr/bin/env python3
import os, re, subprocess, sys
*options, last = sys.argv[1:]
if "--wrap" in options:
    assert [one for one in options if one == "--dependency=afterany:17"]
    sys.exit(subprocess.run(["bash", "-c", last]).returncode)
assert options == ["--parsable"]
first, last_index = map(int, re.search(r"^#SBATCH --array=(\\d+)-(\\d+)$", open(last).read(), re.M).groups())
for k in range(first, last_index + 1):
    values = {"ID": k, "COUNT": last_index - first + 1, "MIN": first, "MAX": last_index, "STEP": 1}
    array = {f"SLURM_ARRAY_TASK_{name}": str(value) for name, value in values.items()}
    subprocess.run(["bash", last], env=os.environ | array, check=True, stdout=2)
print(17)
"""
SUBMITIT = """
class Job:
    def __init__(self, function, value):
        self.work = lambda: function(value)
    def wait(self):
        self.work()
class AutoExecutor:
    def __init__(self, folder): pass
    def update_parameters(self, cpus_per_task, timeout_min): pass
    def map_array(self, function, values):
        return [Job(function, value) for value in values]
"""
SNAKEMAKE = """#!/usr/bin/env python3
import re, subprocess, sys
rules = dict(re.findall(r"^rule (\\w+):\\n(.*?)(?=^rule|\\Z)", open("Snakefile").read(), re.M | re.S))
merge, shard = (re.search(r'shell: "(.*)"', rules[name])[1] for name in ("merge", "shard"))
first, end = map(int, re.search(r"k=range\\((\\d+), (\\d+)\\)", rules["merge"]).groups())
for k in range(first, end):
    subprocess.run(shard.replace("{wildcards.k}", str(k)).replace("{threads}", "1"), shell=True, check=True)
subprocess.run(merge, shell=True, check=True)
"""


@pytest.fixture(scope="module")
def case(tmp_path_factory) -> Path:
    """A study of three short searches, and its result by one run."""
    folder = tmp_path_factory.mktemp("recipes")
    base = tp.Scenario.from_file("plumesim_casting").with_({"duration": 1, "robots.0.trials": 1})
    (folder / "base.yaml").write_text(base.to_yaml())
    speed = {"key": "robots.0.algorithm.speed", "values": [0.2, 0.3, 0.4]}
    study = {"name": "a", "base": "base.yaml", "axes": {"speed": speed}, "airs": 1}
    (folder / "study.yaml").write_text(yaml.safe_dump(study))
    tp.study(folder / "study.yaml", out=folder / "one", workers=1, progress=False)
    return folder


def execute(case: Path, tmp_path: Path, *line: str) -> None:
    """Execute a command with the recipes and a program `python`; compare the study's result with one run's."""
    for name in ("base.yaml", "study.yaml"):
        shutil.copy(case / name, tmp_path)
    for name, text in RECIPES.items():
        (tmp_path / name).write_text(text)
    program(tmp_path, "python", f'#!/bin/sh\nexec {sys.executable} "$@"\n')
    paths = os.pathsep.join([str(tmp_path / "bin"), os.environ["PATH"]])
    modules = os.pathsep.join([str(ROOT), str(tmp_path / "modules")])
    env = os.environ | {"PATH": paths, "PYTHONPATH": modules}
    done = subprocess.run(line, cwd=tmp_path, env=env, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    assert pq.read_table(tmp_path / "wind" / "runs.parquet")["status"].to_pylist() == ["completed"] * 3
    for name in ("plan.parquet", "runs.parquet", "trials/part-0.parquet"):
        for file in (case / "one").glob(name):
            assert (tmp_path / "wind" / name).read_bytes() == file.read_bytes()
    assert (tmp_path / "wind" / "report.html").exists()
    assert not (tmp_path / "wind" / "shards.json").exists()


def program(tmp_path: Path, name: str, text: str) -> None:
    (tmp_path / "bin").mkdir(exist_ok=True)
    (tmp_path / "bin" / name).write_text(text)
    (tmp_path / "bin" / name).chmod(0o755)


def test_recipes_are_short():
    assert RECIPES.keys() == {"shards.sh", "submit.sh", "submit.py", "Snakefile"}
    assert max(text.count("\n") for text in RECIPES.values()) <= 12


def test_slurm(case, tmp_path):
    program(tmp_path, "sbatch", SBATCH)
    execute(case, tmp_path, "bash", "submit.sh")


def test_submitit(case, tmp_path):
    if importlib.util.find_spec("submitit") is None:
        (tmp_path / "modules").mkdir()
        (tmp_path / "modules" / "submitit.py").write_text(SUBMITIT)
    execute(case, tmp_path, "python", "submit.py")


def test_snakemake(case, tmp_path):
    if shutil.which("snakemake") is None:
        program(tmp_path, "snakemake", SNAKEMAKE)
    execute(case, tmp_path, "snakemake", "--cores", "2")
