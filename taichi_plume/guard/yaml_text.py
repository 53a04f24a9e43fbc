"""Safe YAML reader for all input files: scenarios, maps, projects of GADEN, metadata of bags.

A document becomes dicts, lists and scalars. The size, the depth, and the expansion of aliases and merge keys (`<<`) are
limited; duplicate keys, tags of other programs and characters that do not print are refused.
"""

import re
import unicodedata
from pathlib import Path
from typing import Any

import yaml
from yaml.composer import Composer
from yaml.constructor import SafeConstructor
from yaml.resolver import Resolver

from taichi_plume.guard.safe_open import content_of
from taichi_plume.guard.terminal import LONGEST_VALUE, visible

LARGEST_FILE = 1 << 22  # bytes; a second and more per MiB
MOST_VALUES = 100_000  # once aliases are written out; all within LARGEST_FILE
PER_VALUE = 20  # bytes of a text or number that count as one value more
DEEPEST = 32  # levels; those of a scenario are 10
LONGEST_NUMBER = 1000  # characters
LONGEST_TEXT = 10_000  # characters
HARMFUL = {"Cc", "Cf", "Cs", "Zl", "Zp"}  # Unicode: controls, marks of direction, surrogates, line ends
_AT_START = {  # messages of PyYAML, and their meaning
    "could not find expected ':'": "a key needs a colon and a space after it, such as duration: 60 s",
    "found unexpected end of stream": "a quote is opened and not closed",
}
_ELSEWHERE = {
    "but found another document": "a second document begins here (---); keep one",
    "expected <block end>, but found '<block mapping start>'": "this line is indented more than those before it",
    "expected <block end>, but found '-'": "this '-' is not indented as those before it",
    "expected <block end>, but found '<scalar>'": "text after the end of a value; check quotes and brackets",
    "expected ',' or '}', but got '<scalar>'": "a comma or '}' is missing here; units go with each number: [1 m, 2 m]",
    "expected ',' or ']', but got '<scalar>'": "a comma or ']' is missing here",
    "expected ',' or ']', but got '}'": "a '[' is not closed before this '}'",
    "expected ',' or '}', but got ']'": "a '{' is not closed before this ']'",
    "expected ',' or '}', but got ':'": "a '{' of a line above is not closed",
    "expected ',' or ']', but got ':'": "a '[' of a line above is not closed",
}
_READ_OTHERWISE = re.compile(r"[\t?!\ufeff]|[|>][-+\d]*#")
"""Characters that libyaml accepts where PyYAML does not."""
_TAG = "tag:yaml.org,2002:"
_NUMBERS = {f"{_TAG}int", f"{_TAG}float"}
_TEXTS = {f"{_TAG}str", f"{_TAG}merge", f"{_TAG}value"}
_PLAIN = {f"{_TAG}{kind}" for kind in ("null", "bool", "seq", "map")} | _NUMBERS | _TEXTS


class LineError(Exception):
    """Error in a YAML text; the message is one line."""


def weight(value: object) -> int:
    """Return the size of a scalar in units of values, by which documents are limited: a long text counts as several."""
    return 1 + len(str(value).encode(errors="surrogatepass")) // PER_VALUE


def read_text(path: Path) -> str:
    """Return the text of a scenario file, limited in size. Raises LineError."""
    return decode(content_of(path, LARGEST_FILE, LineError, ""))


def decode(content: bytes) -> str:
    """Decode bytes of UTF-8. Raises LineError with the line number if they are not UTF-8."""
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        raise LineError(f"line {line}: is not UTF-8 text") from None


def parse(text: str, kind: str = "a scenario", dates: bool = False) -> Any:
    """Return the YAML document in `text` as dicts, lists and scalars; None if the text is empty.

    kind: kind of file, for messages. dates: read dates, as texts, instead of refusing them. Raises
    LineError.
    """
    if _QUICK is not None and not _READ_OTHERWISE.search(text):
        try:
            return _parsed(_QUICK, text, kind, dates)
        except LineError:
            pass  # the messages are those of PyYAML
    return _parsed(_Loader, text, kind, dates)


def _parsed(load: type, text: str, kind: str, dates: bool) -> Any:
    """Return the document that a loader reads. Raises LineError."""
    loader = None
    try:
        loader = load(text, kind)
        node = loader.get_single_node()
        if node is None:
            return None
        _check_tree(node, dates)
        return loader.construct_document(node)
    except yaml.MarkedYAMLError as error:
        what = " ".join(str(error.problem or error.context).split())
        at_start = what in _AT_START  # the fault lies at the start of the construct
        place = _place(error.context_mark if at_start else error.problem_mark or error.context_mark)
        if what.startswith(r"found character '\t'"):
            raise LineError(f"{place}indent with spaces, not tabs") from None
        if what == "mapping values are not allowed here":
            what += "; check the indentation, or quote a text that contains ': '"
        raise LineError(f"{place}not YAML: {_AT_START.get(what) or _ELSEWHERE.get(what, what)}") from None
    except yaml.reader.ReaderError as error:
        line = text.count("\n", 0, error.position) + 1
        raise LineError(f"line {line}: not YAML: {error.reason}") from None
    except (ValueError, OverflowError) as error:  # of an escape such as "\UFFFFFFFF", or a directive's number
        raise LineError(f"not YAML: {error}") from None
    finally:
        if loader:
            loader.dispose()


class _Limits(Composer, SafeConstructor):
    """Composition and construction that stop as soon as a document is too large or too deeply nested."""

    kind = ""
    values = depth = 0

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        """Parse a YAML node and all nodes below, with a check of size and depth."""
        self.values += 1
        self.depth += 1
        event = self.peek_event()
        if self.values > MOST_VALUES:
            raise _fault(event, f"has more than {MOST_VALUES:,} values; is it {self.kind}?")
        if self.depth > DEEPEST:
            raise _fault(event, f"is nested too deeply, more than {DEEPEST} levels")
        node = super().compose_node(parent, index)
        self.depth -= 1
        return node

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:
        """Return the Python value of a YAML node. Raises LineError if text and tag disagree, such as `!!bool 3`."""
        try:
            return super().construct_object(node, deep)
        except (ValueError, LookupError, TypeError, AttributeError, OverflowError):
            raise _fault(node, f"'{_shown(node)}' is no {node.tag.replace(_TAG, '')}") from None


class _Loader(_Limits, yaml.SafeLoader):
    """YAML loader of PyYAML with limits."""

    def __init__(self, text: str, kind: str):
        yaml.SafeLoader.__init__(self, text)
        self.kind = kind


_QUICK: type | None = None
if yaml.__with_libyaml__:  # libyaml's parser takes a quarter of the time
    from yaml.cyaml import CParser

    class _LibyamlLoader(_Limits, CParser, Resolver):
        """YAML loader with limits whose events come from libyaml."""

        def __init__(self, text: str, kind: str):
            CParser.__init__(self, text)
            Composer.__init__(self)
            SafeConstructor.__init__(self)
            Resolver.__init__(self)
            self.kind = kind

    _QUICK = _LibyamlLoader


def _place(mark: yaml.Mark | None) -> str:
    return f"line {mark.line + 1}, column {mark.column + 1}: " if mark else ""


def _fault(node: yaml.Node | yaml.Event, what: str) -> LineError:
    return LineError(f"{_place(node.start_mark)}{what}")


def _check_tree(root: yaml.Node, dates: bool) -> None:
    """Raise LineError for unknown tags, duplicate keys, recursive aliases, or aliases that expand too far."""
    sizes: dict[int, int] = {}
    depths: dict[int, int] = {}  # of lists and mappings
    open_nodes: set[int] = set()

    def size(node: yaml.Node) -> int:
        key = id(node)
        if key in sizes:
            return sizes[key]
        if key in open_nodes:
            raise _fault(node, "an alias contains itself")
        _check_kind(node, dates)
        if isinstance(node, yaml.ScalarNode):
            _check_scalar(node)
            sizes[key] = weight(node.value)
            return sizes[key]
        open_nodes.add(key)
        if isinstance(node, yaml.MappingNode):
            _check_keys(node)
            parts = [part for pair in node.value for part in pair]
        else:
            parts = node.value
        sizes[key] = 1 + sum([size(part) for part in parts])
        depths[key] = 1 + max([depths.get(id(part), 1) for part in parts], default=0)
        open_nodes.remove(key)
        if sizes[key] > MOST_VALUES:
            raise _fault(node, f"aliases expand to more than {MOST_VALUES:,} values; use fewer")
        if depths[key] > DEEPEST:
            raise _fault(node, f"aliases nest it too deeply, more than {DEEPEST} levels")
        return sizes[key]

    size(root)


def _check_kind(node: yaml.Node, dates: bool) -> None:
    if node.tag == f"{_TAG}timestamp" and isinstance(node, yaml.ScalarNode):
        if dates:
            node.tag = f"{_TAG}str"
            return
        raise _fault(node, f"{_shown(node)} is a date; put it in quotes if it is a text")
    if node.tag not in _PLAIN:
        tag = visible(node.tag.replace(_TAG, "!!"), LONGEST_VALUE)
        raise _fault(node, f"{tag} is not taken; plain texts, numbers, lists and mappings are")


def _check_scalar(node: yaml.ScalarNode) -> None:
    if node.tag in _NUMBERS and len(node.value) > LONGEST_NUMBER:
        raise _fault(
            node, f"a number of {len(node.value):,} characters; at most {LONGEST_NUMBER:,} are taken"
        )
    if fault := text_fault(node.value):
        raise _fault(node, fault)


def text_fault(text: str) -> str | None:
    """Return the reason why a document must not have a text: its length, or a character; None if it may."""
    if len(text) > LONGEST_TEXT:
        return f"a text of {len(text):,} characters; at most {LONGEST_TEXT:,} are taken"
    harmful = (c for c in text if c not in "\n\t" and unicodedata.category(c) in HARMFUL)
    if not text.isprintable() and (character := next(harmful, None)):
        return f"has the character {visible(character)}, which does not print"
    return None


def _check_keys(mapping: yaml.MappingNode) -> None:
    lines: dict[str, int] = {}
    for key, _ in mapping.value:
        if not isinstance(key, yaml.ScalarNode) or key.tag not in _TEXTS:
            raise _fault(key, "a key must be a text; put it in quotes, or write a list in brackets: [1, 2]")
        if key.value in lines:
            first = lines[key.value]
            raise _fault(key, f"duplicate key '{_shown(key)}', first on line {first}; remove one")
        lines[key.value] = key.start_mark.line + 1


def _shown(node: yaml.Node) -> str:
    return visible(node.value, LONGEST_VALUE)
