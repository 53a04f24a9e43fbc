"""The gallery of the documentation: every config is in it, with pictures of the config as it is."""

import re
import shlex
from pathlib import Path

import pytest
from PIL import Image
from scripts import loaded

from taichi_plume.assembly.preparation import load

ROOT = Path(__file__).resolve().parents[1]
GALLERY = ROOT / "docs/gallery"
CONFIGS = sorted(path.stem for path in (ROOT / "configs").glob("*.yaml"))
TEXT = (GALLERY / "index.md").read_text(encoding="utf-8")
ENTRIES = dict(re.findall(r"^## (\w+)\n(.*?)(?=^## |\Z)", TEXT, re.M | re.S))
COMMANDS = re.findall(r"^python -m taichi_plume.run (.+)$", TEXT, re.M)
MOST = 3_900_000  # bytes of all pictures


@pytest.fixture(scope="module")
def make():
    return loaded(GALLERY / "make.py")


def kept(make) -> dict:
    return make.json.loads(make.KEPT.read_text(encoding="utf-8"))


def test_every_config_is_in_the_gallery():
    assert sorted(ENTRIES) == CONFIGS


@pytest.mark.parametrize("name", CONFIGS)
def test_an_entry_has_its_pictures_its_story_and_its_command(make, name):
    shown = re.findall(r"!\[.+\]\(pictures/(.+)\)", ENTRIES[name])
    assert sorted(shown) == kept(make)[name]["pictures"]
    story = re.sub(r"!\[[^\n]*|```.*?```", "", ENTRIES[name], flags=re.S)
    assert len(re.findall(r"[.:;]\s", story)) >= 3
    assert f"python -m taichi_plume.run configs/{name}.yaml\n" in ENTRIES[name]


@pytest.mark.parametrize("name", CONFIGS)
def test_pictures_are_of_the_config_as_it_is(make, name):
    """Where this fails, ``python docs/gallery/make.py NAME`` draws the config anew."""
    assert kept(make)[name]["config"] == make.digest(ROOT / "configs" / f"{name}.yaml")


def test_pictures_are_small_and_all_are_shown(make):
    files = sorted((GALLERY / "pictures").iterdir())
    assert [path.name for path in files] == sorted(
        file for one in kept(make).values() for file in one["pictures"]
    )
    assert sum(path.stat().st_size for path in files) <= MOST
    for path in files:
        assert path.stat().st_size <= make.largest(path)
        with Image.open(path) as image:
            assert image.width >= 400
            assert getattr(image, "n_frames", 1) >= (10 if path.suffix == ".gif" else 1)


def test_films_in_the_readme_stand_over_their_commands(make):
    films, _, commands = re.findall(r"^\| .*|^\|-.*", (ROOT / "README.md").read_text(encoding="utf-8"), re.M)[
        :3
    ]
    assert tuple(re.findall(r"!\[[^\]]+\]\(docs/gallery/pictures/(.+?)\)", films)) == make.TILES
    names = re.findall(r"`python -m taichi_plume\.run configs/(\w+)\.yaml`", commands)
    assert [f"{name}.gif" for name in names] == list(make.TILES)


@pytest.mark.parametrize("command", COMMANDS)
def test_the_commands_of_the_gallery_are_of_scenarios(command):
    path, *options = shlex.split(command)
    assert options[0::2] == ["--set"] * (len(options) // 2)
    load(ROOT / path, options[1::2])


def test_a_picture_that_is_too_large_loses_colours(make, tmp_path):
    import numpy as np

    noise = np.random.default_rng(1).integers(0, 255, (400, 500, 3), dtype=np.uint8)
    Image.fromarray(noise).save(tmp_path / "noise.png")
    assert (tmp_path / "noise.png").stat().st_size > make.LARGEST
    make.fit(tmp_path / "noise.png")
    assert (tmp_path / "noise.png").stat().st_size <= make.LARGEST
