"""The documentation, built without a network: ``python -m sphinx -W --keep-going -b html docs docs/_build/html``."""

import re
import sys
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
ROOT = HERE.parent
sys.path[:0] = [str(ROOT), str(HERE / "_ext")]

import taichi_plume  # noqa: E402  first of all: it keeps Taichi from the network

project = "taichi_plume"
author = "the authors of taichi_plume"
copyright = "the authors of taichi_plume, Apache-2.0"
version = release = taichi_plume.__version__

extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx_gallery.gen_gallery", "mathml"]
extensions += ["scenario_reference", "validation_page"]  # they write pages before a build
exclude_patterns = ["_build", "_ext", "tutorial", "gallery/live", "validation/*", "**/GALLERY_HEADER.*"]
exclude_patterns += ["tutorials/*.ipynb", "gallery/runs/*.ipynb"]  # sphinx-gallery's copies, to be downloaded
nitpicky = False

# Text
myst_enable_extensions = ["dollarmath", "deflist", "colon_fence", "attrs_inline", "attrs_block"]
myst_heading_anchors = 3
myst_links_external_new_tab = False
default_role = "code"  # single backticks in docstrings
html_math_renderer = "mathml"
suppress_warnings = ["config.cache"]  # sphinx-gallery's settings hold functions
pygments_style = "default"

# The API, from docstrings
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_member_order = "bysource"


# Tutorials: executed when they have changed, each in the folder it lies in
def pictures_written(block, block_vars, gallery_conf):
    """Take up the PNG files that a block of a tutorial names, besides what it has drawn with matplotlib."""
    from shutil import move

    from sphinx_gallery.scrapers import figure_rst

    folder, targets = Path(block_vars["src_file"]).parent, block_vars["image_path_iterator"]
    named = re.findall(r"--out (\S+\.png)", block[1]) if block[0] == "code" else []
    # fails where a command has drawn none
    taken: list[Any] = [str(move(folder / name, next(targets))) for name in named]
    return figure_rst(taken, gallery_conf["src_dir"])


sphinx_gallery_conf = {
    "examples_dirs": ["tutorial", "gallery/live"],
    "gallery_dirs": ["tutorials", "gallery/runs"],
    "filename_pattern": r"/(plot|run)_",
    "ignore_pattern": r"__init__\.py|conf\.py",
    "image_scrapers": ("matplotlib", pictures_written),
    "abort_on_example_error": True,
    "within_subsection_order": "FileNameSortKey",
    "capture_repr": ("_repr_html_",),  # tables, and not what matplotlib returns
    "thumbnail_size": (480, 373),
    "download_all_examples": False,
    "show_memory": False,
    "show_signature": False,
    "write_computation_times": False,
    "remove_config_comments": True,
    "min_reported_time": 1e9,
}

# Notebooks: stored without outputs, executed whenever their page is built, each in a temporary folder
nb_execution_mode = "force"
nb_execution_in_temp = True
nb_execution_raise_on_error = True
nb_execution_timeout = 300  # s per cell
nb_merge_streams = True
nb_ipywidgets_js: dict[str, dict[str, str]] = {}  # no scripts from another host

# Pages
html_theme = "pydata_sphinx_theme"
html_title = "taichi_plume"
html_static_path = ["_static"]
html_css_files = ["taichi_plume.css"]
html_favicon = "_static/logo.svg"
html_copy_source = False
html_show_sourcelink = False
html_show_sphinx = False
html_last_updated_fmt = None
html_sidebars = {page: [] for page in ("install", "api")}  # single pages have no section to navigate
html_theme_options = {
    "logo": {"image_light": "_static/logo.svg", "image_dark": "_static/logo.svg", "text": "taichi_plume"},
    "header_links_before_dropdown": 9,
    "navbar_align": "left",
    "navbar_persistent": ["search-button"],
    "navbar_end": ["theme-switcher"],
    "secondary_sidebar_items": ["page-toc"],
    "show_toc_level": 1,
    "show_prev_next": True,
    "footer_start": ["copyright"],
    "footer_end": [],
    "pygments_light_style": "default",
    "pygments_dark_style": "github-dark",
}
