"""Bags are read in a process with limits: a small one cannot fill the memory or the disk, nor take for ever."""

import tempfile
from pathlib import Path

import hostile_bags as hostile
import numpy as np
import pytest
from refusals import refused

from taichi_plume.files import bag_readings, bags
from taichi_plume.files.bags import BagError


def test_what_is_read_there_is_what_is_read_here(tmp_path: Path) -> None:
    bag = hostile.good(tmp_path / "a")
    (there,), (here,) = bag_readings.read(bag), bag_readings.read_here(bag, bag_readings.Wanted())
    for name, value in vars(here).items():
        assert np.array_equal(vars(there)[name], value)


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("compressed file", "File too large"),
        ("compressed chunk", "memory"),
        ("endless view", "computing time"),
        ("large column", "out of memory"),
        ("qualities of service", "computing time"),
        ("metadata", "anchors and aliases are not allowed"),
        ("definition", "memory|computing time"),
    ],
)
def test_each_ends_in_a_line(name: str, told: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if told == "computing time":
        monkeypatch.setattr(bags, "SECONDS", 0.5)
    (tmp_path / "tmp").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "tmp"))
    bag = hostile.ALL[name](tmp_path / "a")
    with refused(BagError, bag, told):
        bag_readings.read(bag)
    assert not list((tmp_path / "tmp").iterdir())  # what was unpacked is gone
