"""Damaged bags: what can be read is read, anything else ends in one line."""

from pathlib import Path

import numpy as np
import pytest
from recorded_bag import gas, pose, write

from taichi_plume.files import bag_readings
from taichi_plume.files.bags import BagError


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_damage_is_reported_in_a_line(tmp_path: Path, storage: str) -> None:
    messages = [(t / 4, "/odom", pose(t / 4, 0.1 * t, 1.0, 0.0)) for t in range(20)]
    folder = write(tmp_path / "a", [*messages, (2.0, "/gas", gas(2.0, 5.0))], storage)
    (whole,) = bag_readings.read(folder)
    assert whole.ppm.tolist() == [5.0]
    rng, reported = np.random.default_rng(3), 0
    for file in folder.iterdir():
        sound = file.read_bytes()
        for n in range(40):
            damaged = bytearray(sound[: rng.integers(1, len(sound)) if n % 2 else None])
            for _ in range(8):
                damaged[rng.integers(len(damaged))] = rng.integers(256)
            file.write_bytes(damaged)
            try:
                bag_readings.read(folder)
            except BagError as error:
                reported += "\n" not in str(error) and str(error).startswith(str(folder))
        file.write_bytes(sound)
    assert reported > 30
