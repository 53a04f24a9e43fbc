"""Formulas as MathML, made at build time by docutils: pages need no script and no other host to show them."""

import re
from html import escape

from docutils import nodes
from docutils.utils.math import MathError
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx
from sphinx.util import logging
from sphinx.writers.html5 import HTML5Translator

# In TeX a fraction or a power takes one digit; docutils takes the whole number.
DIGITS = {r"(\\[dt]?frac)\s*(\d)(\d)": r"\1{\2}{\3}", r"([\^_])(\d)(?=\d)": r"\1{\2}"}
SIGNS = {"°": r"{}^{\circ}", "²": "^2", "³": "^3", "·": r"\cdot "}  # unknown to docutils in formulas


def made(node: nodes.Element, as_block: bool) -> str:
    """MathML of a formula. A formula that docutils cannot parse gives a warning and is shown as source."""
    text = node.astext()
    for sign, tex in SIGNS.items():
        text = text.replace(sign, tex)
    for digits, tex in DIGITS.items():
        text = re.sub(digits, tex, text)
    try:
        return tex2mathml(text, as_block=as_block)
    except MathError as error:
        logging.getLogger(__name__).warning("formula: %s", error, location=node)
        return f"<code>{escape(node.astext())}</code>"


def inline(writer: HTML5Translator, node: nodes.math) -> None:
    """Write an inline formula."""
    writer.body.append(made(node, as_block=False))
    raise nodes.SkipNode


def block(writer: HTML5Translator, node: nodes.math_block) -> None:
    """Write a displayed formula, with its number if present."""
    number = f'<span class="eqno">({node["number"]})</span>' if node.get("number") else ""
    identity = f' id="{node["ids"][0]}"' if node.get("ids") else ""
    writer.body.append(f'<div class="math"{identity}>{number}{made(node, as_block=True)}</div>')
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the renderer `mathml` in Sphinx."""
    app.add_html_math_renderer("mathml", (inline, None), (block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
