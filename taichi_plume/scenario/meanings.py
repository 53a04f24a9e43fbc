"""What the keys of a section mean, as written below each in its class: for the schema and for help texts.

pydantic would read the sources of all sections at every start, which takes a fifth of making them.
"""

import ast
import inspect
import textwrap
from functools import cache
from itertools import pairwise

from pydantic import BaseModel


@cache
def meanings(model: type[BaseModel]) -> dict[str, str]:
    """By the key; what a base class says of it holds unless a class says it anew. A `kind` means its section."""
    found = {"kind": purpose(model)}
    for one in reversed(model.__mro__):
        if issubclass(one, BaseModel) and one is not BaseModel:
            (section,) = ast.parse(textwrap.dedent(inspect.getsource(one))).body
            assert isinstance(section, ast.ClassDef)
            for key, text in pairwise([*section.body, ast.Pass()]):
                if isinstance(key, ast.AnnAssign) and isinstance(key.target, ast.Name):
                    if isinstance(text, ast.Expr) and isinstance(text.value, ast.Constant):
                        assert isinstance(text.value.value, str)
                        found[key.target.id] = " ".join(inspect.cleandoc(text.value.value).split())
    return {key: found[key] for key in model.model_fields if key in found}


def purpose(model: type[BaseModel]) -> str:
    """What a section is, in a line: the first paragraph of its class's docstring."""
    return " ".join(inspect.cleandoc(model.__doc__ or "").split("\n\n")[0].split())
