"""Texts of the source that people read: docstrings, messages and comments, with their place in a file.

``python -m tests.wording`` prints what breaks the rules of `test_wording.py`; ``--messages`` prints all messages.
"""

import ast
import io
import re
import sys
import tokenize
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
FOLDERS = ("taichi_plume", "solvers", "agents", "validation")

FIRST_WORDS = re.compile(r"(Of|That|What|How|Those|Whether (it|they)|It|Its|They|Their|Some|One) ", re.ASCII)
DIALECT = re.compile(
    r"\b(told|tells|tell of|noses?|anew|whence|in vain|misfits?|unfit|clashes|reels?|bells|deaf|openness|listens?|"
    r"as it stands|stands for itself|going on)\b",
    re.IGNORECASE,
)
LONGEST_SENTENCE = 40  # words
SENTENCE_END = re.compile(r"[.:;!?)](?=\s|$)|\n\s*\n|\n\s*[-|*]|::")
NAMES = {
    "told",
    "tells",
    "noses",
    "few",
    "bell",
    "bells",
    "judge",
    "misfits",
    "unfit",
    "deaf",
    "ears",
    "reel",
    "snaps",
    "kept",
    "wanted",
    "said",
    "one",
    "openness",
    "anew",
}


@dataclass(frozen=True)
class Text:
    """A text and its place."""

    file: str
    line: int
    kind: str  # docstring, message, comment or name
    words: str

    def __str__(self) -> str:
        return f"{self.file}:{self.line}: {self.kind}: {' '.join(self.words.split())}"


def files() -> list[Path]:
    """Return the Python files of the source."""
    return [path for folder in FOLDERS for path in sorted((ROOT / folder).rglob("*.py"))]


def _docstrings(tree: ast.Module) -> Iterator[ast.Constant]:
    """Yield docstrings of modules, classes and functions, and texts below attributes."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            if isinstance(node.value.value, str):
                yield node.value


def _literal(node: ast.expr) -> str:
    """Return the text of a string or f-string, with braces for what is filled in."""
    if isinstance(node, ast.Constant):
        return node.value if isinstance(node.value, str) else ""
    if isinstance(node, ast.JoinedStr):
        return "".join(
            "{}" if isinstance(part, ast.FormattedValue) else _literal(part) for part in node.values
        )
    return ""


def texts(path: Path) -> Iterator[Text]:
    """Yield the texts of a file. A message is any other string of at least three words."""
    source, place = path.read_text(encoding="utf-8"), str(path.relative_to(ROOT))
    tree = ast.parse(source)
    docstrings = list(_docstrings(tree))
    inner = {id(part) for node in ast.walk(tree) if isinstance(node, ast.JoinedStr) for part in node.values}
    for text in docstrings:
        yield Text(place, text.lineno, "docstring", str(text.value))
    seen = inner | set(map(id, docstrings))
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant | ast.JoinedStr) and id(node) not in seen:
            words = _literal(node)
            if len(re.findall(r"[A-Za-z]{2,}", words)) >= 3 and " " in words.strip():
                yield Text(place, node.lineno, "message", words)
    for node in ast.walk(tree):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield Text(place, node.lineno, "name", node.id)
        elif isinstance(node, ast.FunctionDef | ast.ClassDef | ast.AsyncFunctionDef):
            yield Text(place, node.lineno, "name", node.name)
        elif isinstance(node, ast.arg):
            yield Text(place, node.lineno, "name", node.arg)
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT:
            yield Text(place, token.start[0], "comment", token.string.lstrip("# "))


def faults(text: Text) -> list[str]:
    """Return what in a text breaks the rules."""
    if text.kind == "name":
        return [text.words] if text.words.strip("_").lower() in NAMES else []
    found = [match.group() for match in DIALECT.finditer(text.words)]
    if text.kind == "docstring":
        if start := FIRST_WORDS.match(text.words):
            found.append(f"begins with '{start.group().strip()}'")
        longest = max((len(part.split()) for part in SENTENCE_END.split(text.words) if part), default=0)
        if longest > LONGEST_SENTENCE:
            found.append(f"a sentence of {longest} words")
    return found


def main() -> None:
    """Print the faults or, with --messages, the messages."""
    for path in files():
        for text in texts(path):
            if "--messages" in sys.argv:
                if text.kind == "message":
                    print(text)
            elif broken := faults(text):
                print(f"{text.file}:{text.line}: {text.kind}: {', '.join(broken)}")


if __name__ == "__main__":
    main()
