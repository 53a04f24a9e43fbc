"""Formulas as MathML, made at build time by docutils: pages show them without a script and without another host."""

import re
from html import escape

from docutils import nodes
from docutils.utils.math import MathError
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx
from sphinx.util import logging
from sphinx.writers.html5 import HTML5Translator

# In TeX what follows a fraction or a power is one digit, docutils takes the whole number.
DIGITS = {r"(\\[dt]?frac)\s*(\d)(\d)": r"\1{\2}{\3}", r"([\^_])(\d)(?=\d)": r"\1{\2}"}
SIGNS = {"°": r"{}^{\circ}", "²": "^2", "³": "^3", "·": r"\cdot "}  # that docutils does not know in formulas


def made(node: nodes.Element, as_block: bool) -> str:
    """The MathML of a formula; what docutils cannot read is warned of, and shown as it was written."""
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
    """A formula in a line of text."""
    writer.body.append(made(node, as_block=False))
    raise nodes.SkipNode


def block(writer: HTML5Translator, node: nodes.math_block) -> None:
    """A formula that stands by itself, with its number if it has one."""
    number = f'<span class="eqno">({node["number"]})</span>' if node.get("number") else ""
    identity = f' id="{node["ids"][0]}"' if node.get("ids") else ""
    writer.body.append(f'<div class="math"{identity}>{number}{made(node, as_block=True)}</div>')
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, bool]:
    """Tell Sphinx of the renderer `mathml`."""
    app.add_html_math_renderer("mathml", (inline, None), (block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
