"""Figures keep their text as text in PDF and SVG, whoever saves them and with whatever settings of matplotlib."""

import io
import re
import xml.etree.ElementTree as ET

import made_run
import matplotlib as mpl
import pytest
from matplotlib.figure import Figure
from matplotlib.text import Text

from taichi_plume.__main__ import main
from taichi_plume.report import scene
from taichi_plume.results.run import Run


def fonts(pdf: bytes) -> set[str]:
    """Return the kinds of fonts in a PDF file, such as "Type3"."""
    kinds = re.findall(rb"/Type /Font\b[^>]*?/Subtype /(\w+)|/Subtype /(\w+)[^>]*?/Type /Font\b", pdf)
    return {(first or second).decode() for first, second in kinds}


def texts(svg: bytes) -> str:
    """Return all text of an SVG file."""
    root = ET.fromstring(svg)
    found = root.iter("{http://www.w3.org/2000/svg}text")
    return "|".join("".join(element.itertext()) for element in found)


def saved(figure: Figure, kind: str) -> bytes:
    """Return the file that a user's `savefig` writes, with the settings of matplotlib's own defaults."""
    file = io.BytesIO()
    with mpl.rc_context(mpl.rcParamsDefault):
        figure.savefig(file, format=kind)
    return file.getvalue()


def written(figure: Figure) -> set[str]:
    """Return the texts that a figure shows."""
    return {
        text.get_text() for text in figure.findobj(Text) if text.get_visible() and text.get_text().strip()
    }


def test_figures_from_python_keep_their_text():
    model = made_run.scenario()
    figure = scene.figure_of(model, scene.simple_shapes(model))
    assert any("cylinder" in text for text in written(figure))
    assert fonts(saved(figure, "pdf")) <= {"Type0", "CIDFontType2", "TrueType"}
    assert fonts(saved(figure, "pdf"))
    kept = texts(saved(figure, "svg"))
    assert not [text for text in written(figure) if text not in kept]


@pytest.mark.parametrize("kind", ["pdf", "svg"])
def test_the_picture_command_keeps_text(tmp_path, kind):
    folder = made_run.made(tmp_path / "run")
    out = tmp_path / f"x.{kind}"
    assert main(["picture", str(folder), "--at", "5", "--out", str(out)]) == 0
    content = out.read_bytes()
    if kind == "pdf":
        assert "Type3" not in fonts(content)
        assert fonts(content)
    else:
        assert not [
            text for text in written(Run(folder, lenient=True).plot(at=5)) if text not in texts(content)
        ]
