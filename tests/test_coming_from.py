"""The pages for those who come from other simulators: their scenarios load, their examples run."""

import re
import runpy
import shutil
import sys
from math import pi
from pathlib import Path

import numpy as np
import pytest
import zarr

from taichi_plume.assembly.assemble import assemble
from taichi_plume.assembly.preparation import load, load_scenario
from taichi_plume.grid.fields import ppm_at

pytestmark = pytest.mark.usefixtures("taichi")
ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / "docs/coming-from"
BLOCKS = [
    (page.stem, text)
    for page in sorted(FOLDER.glob("*.md"))
    for text in re.findall(r"^```yaml\n(.*?)^```", page.read_text(encoding="utf-8"), re.M | re.S)
]
MOVIE = (6, 40, 60)  # frames, rows, columns of 2 cm


def script(name: str, *args: object) -> None:
    """Run a script of the pages."""
    before, sys.argv = sys.argv, [name, *map(str, args)]
    try:
        runpy.run_path(str(FOLDER / name), run_name="__main__")
    finally:
        sys.argv = before


@pytest.fixture(scope="module")
def files(tmp_path_factory) -> Path:
    """What the scenarios of the pages read."""
    folder = tmp_path_factory.mktemp("files")
    shutil.copy(ROOT / "configs/plumes/casting_room.pslog", folder)
    rows = "".join(f"{n},{0.2 * (n % 20):.3g},{0.2 * (n // 20):.3g},{n % 7}\n" for n in range(300))
    for number in (1, 2):
        (folder / f"plume{number:03d}.txt").write_text(f"cellnumber,x,y,chemical\n{rows}")
    group = zarr.open_group(folder / "movie.zarr", mode="w")
    movie = np.random.default_rng(1).random(MOVIE).astype("f4")
    group.create_array("concentration", data=movie)
    group.attrs.update(fps=15, pixel_to_grid=0.02, origin=[0.0, 0.0])
    script("gaden_room.py", folder)
    shutil.copy(FOLDER / "gaden_room.yaml", folder)
    return folder


@pytest.mark.parametrize(
    ("page", "text"), BLOCKS, ids=[re.findall(r"name: (\w+)", text)[0] for _, text in BLOCKS]
)
def test_the_scenarios_of_the_pages_load(files, page, text):
    path = files / "block.yaml"
    path.write_text(text, encoding="utf-8")
    load(path)


def test_there_are_scenarios_on_the_pages():
    assert {page for page, _ in BLOCKS} == {"plumesim", "plume-nav-sim"}


@pytest.mark.slow
def test_the_static_gaussian_is_what_its_page_says(files):
    text = next(text for _, text in BLOCKS if "static_gaussian" in text)
    (files / "gaussian.yaml").write_text(text, encoding="utf-8")
    simulation = assemble(load_scenario(files / "gaussian.yaml"), files)
    points = np.array([[6.4, 6.4], [8.4, 6.4]])
    found = ppm_at(simulation.gas, points, 0.0)[:, 0]
    assert found == pytest.approx([100.0, 100.0 * np.exp(-0.5)], rel=2e-3)


@pytest.mark.slow
def test_gaden_s_room_runs_with_the_gas_of_its_filaments(files):
    overrides = ["duration=1 s", "warm_up=2 s"]
    simulation = assemble(load_scenario(files / "gaden_room.yaml", overrides), files)
    simulation.run()
    # 10 filaments per second, 20 ppm in the middle of each, of ethanol
    mole = 20e-6 * 101325.0 / (8.314462618 * 298.15) * (2 * pi) ** 1.5 * 0.1**3
    emitted = simulation.gas.gases[0].budget()["emitted_kg"]
    assert emitted == pytest.approx(10 * mole * 46.069e-3 * 3.0, rel=0.02)


@pytest.mark.slow
def test_a_movie_is_played_as_it_is(files):
    text = next(text for _, text in BLOCKS if "name: movie" in text)
    (files / "movie.yaml").write_text(text, encoding="utf-8")
    simulation = assemble(load_scenario(files / "movie.yaml"), files)
    movie = np.asarray(zarr.open_group(files / "movie.zarr", mode="r")["concentration"])
    points = 0.02 * (np.array([[0, 0], [59, 39], [7, 30]]) + 0.5)
    found = ppm_at(simulation.gas, points, 0.0)[:, 0]
    assert found == pytest.approx(500 * movie[0, [0, 39, 30], [0, 59, 7]], rel=1e-3)
