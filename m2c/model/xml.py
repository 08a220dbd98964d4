"""Reading XML that may be hostile, keeping the exact place of every element and attribute.

Expat is used rather than lxml because lxml keeps an element's line but not its column, and every
message of this project names both. No document type, so no entities; no network; bounded size and
depth. Namespaces are not resolved: real model files carry ``xmlns="..."``, another's namespace or
prefixes that nobody declared, so names are compared without their prefix.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from xml.parsers import expat

from m2c.model.diagnostics import DiagnosticLog, Position
from m2c.model.file_size import size_of

MAX_BYTES = 4 * 1024 * 1024
"""The largest published model has 40 kB; a hundred times that is not a model."""
MAX_DEPTH = 64
"""Executable content nests a handful deep; the bound keeps every later walk recursion-safe."""

SCXML_NAMESPACE = "http://www.w3.org/2005/07/scxml"

MAX_ELEMENTS = 50_000
MAX_ATTRIBUTES = 100
"""A hundred times what published models have: bounds the work of every later check."""

_TAG_MARKS = re.compile(rb"[\"'>]")
_NAME = re.compile(r"<[^\s/>]+")
_ATTRIBUTE = re.compile(r"\s+([^\s=]+)\s*=\s*(?:\"([^\"]*)\"|'([^']*)')")


class Element:
    """An XML element: ``tag`` without prefix, ``attributes`` without namespace declarations."""

    __slots__ = ("_positions", "attributes", "children", "position", "tag", "text")

    def __init__(
        self,
        tag: str,
        attributes: dict[str, str],
        position: Position,
        positions: dict[str, Position],
    ) -> None:
        self.tag = tag
        self.attributes = attributes
        self.position = position
        self.children: list[Element] = []
        self.text = ""
        self._positions = positions

    def get(self, name: str, default: str = "") -> str:
        """The value of attribute ``name``, stripped of surrounding blanks."""
        return self.attributes.get(name, default).strip()

    def at(self, name: str) -> Position:
        """Where the value of attribute ``name`` starts (the element, if it has no such attribute)."""
        return self._positions.get(name, self.position)

    def all(self, *tags: str) -> Iterator[Element]:
        """The children with one of ``tags``."""
        return (child for child in self.children if child.tag in tags)

    def first(self, tag: str) -> Element | None:
        """The first child called ``tag``."""
        return next(self.all(tag), None)


_INVALID_TOKEN = expat.errors.codes[expat.errors.XML_ERROR_INVALID_TOKEN]


class _Refused(Exception):
    """Parsing stops: the document is hostile."""

    def __init__(self, position: Position, message: str, hint: str) -> None:
        super().__init__(message)
        self.position = position
        self.message = message
        self.hint = hint


def read_xml(path: Path, log: DiagnosticLog) -> Element | None:
    """Parse the file at ``path``; report and return None if it cannot be read.

    Rules reported: ``unreadable-file``, ``hostile-xml``, ``malformed-xml``, and the warnings
    ``xml-prologue`` (blank lines before ``<?xml``) and ``xml-namespace``.
    """
    file = str(path)
    whole = Position(file)
    try:
        size = size_of(path)
        if size > MAX_BYTES:
            log.error(
                "hostile-xml",
                whole,
                "",
                f"the file has {size} bytes",
                f"a model has at most {MAX_BYTES} bytes",
            )
            return None
        content = path.read_bytes()
    except OSError as error:
        log.error("unreadable-file", whole, "", f"cannot read the file: {error.strerror}")
        return None
    return parse_xml(content, file, log)


def parse_xml(content: bytes, file: str, log: DiagnosticLog) -> Element | None:
    """Parse ``content``, which messages call ``file``; see :func:`read_xml`."""
    stripped = content.removeprefix(b"\xef\xbb\xbf").lstrip()
    if not stripped:
        log.error("malformed-xml", Position(file, 1, 1), "", "the file is empty")
        return None
    offset_lines = content[: len(content) - len(stripped)].count(b"\n")
    if offset_lines and stripped.startswith(b"<?xml"):
        log.warning(
            "xml-prologue",
            Position(file, offset_lines + 1, 1),
            "?xml",
            "blank lines before the XML declaration",
            "the declaration belongs at the very start of the file",
        )
    parser = _Parser(stripped, file, offset_lines)
    try:
        root = parser.parse()
    except expat.ExpatError as error:
        position = Position(file, error.lineno + offset_lines, error.offset + 1)
        reason = expat.errors.messages[error.code]
        open_tag = f"; <{parser.open_tag}> is open" if parser.open_tag else ""
        stray = error.code == _INVALID_TOKEN and parser.at_error == b"<"
        hint = "write &lt; for <" if stray else ""
        log.error("malformed-xml", position, "", f"malformed XML: {reason}{open_tag}", hint)
        return None
    except LookupError as error:  # the encoding of the XML declaration
        log.error("malformed-xml", Position(file, 1, 1), "", f"{error}", "write the file in UTF-8")
        return None
    except _Refused as refused:
        log.error("hostile-xml", refused.position, "", refused.message, refused.hint)
        return None
    namespace = parser.namespace
    if namespace != SCXML_NAMESPACE and root.tag in ("scxml", "ascxml"):
        log.warning(
            "xml-namespace",
            root.position,
            root.tag,
            f'the namespace is "{namespace}"' if namespace else "no namespace is declared",
            f'xmlns="{SCXML_NAMESPACE}" is the standard\'s',
        )
    return root


class _Parser:
    """Builds :class:`Element` trees from expat's events."""

    def __init__(self, content: bytes, file: str, offset_lines: int) -> None:
        self._content = content
        self._file = file
        self._offset_lines = offset_lines
        self._stack: list[Element] = []
        self._root: Element | None = None
        self._elements = 0
        self.namespace = ""
        self._expat = parser = expat.ParserCreate()
        parser.buffer_text = True
        parser.StartElementHandler = self._start
        parser.EndElementHandler = self._end
        parser.CharacterDataHandler = self._characters
        parser.StartDoctypeDeclHandler = self._doctype

    def parse(self) -> Element:
        self._expat.Parse(self._content, True)
        assert self._root is not None  # expat reports a document without a root itself
        return self._root

    @property
    def open_tag(self) -> str:
        return self._stack[-1].tag if self._stack else ""

    @property
    def at_error(self) -> bytes:
        """The byte at which expat gave up."""
        index = self._expat.ErrorByteIndex
        return self._content[index : index + 1]

    def here(self) -> Position:
        line = self._expat.CurrentLineNumber + self._offset_lines
        return Position(self._file, line, self._expat.CurrentColumnNumber + 1)

    def _doctype(self, name: str, *_: object) -> None:
        raise _Refused(
            self.here(),
            f"a document type declaration (<!DOCTYPE {name}…>) is refused",
            "models need no entities; remove it",
        )

    def _start(self, name: str, attributes: dict[str, str]) -> None:
        if len(self._stack) >= MAX_DEPTH:
            raise _Refused(
                self.here(),
                f"elements are nested more than {MAX_DEPTH} deep",
                "a model is a few levels deep",
            )
        self._elements += 1
        if self._elements > MAX_ELEMENTS or len(attributes) > MAX_ATTRIBUTES:
            what = "attributes in an element" if len(attributes) > MAX_ATTRIBUTES else "elements"
            most = MAX_ATTRIBUTES if len(attributes) > MAX_ATTRIBUTES else MAX_ELEMENTS
            raise _Refused(
                self.here(), f"more than {most} {what}", "a model has a few hundred elements"
            )
        kept: dict[str, str] = {}
        for key, value in attributes.items():
            if key == "xmlns" and not self._stack:
                self.namespace = value
            elif key == "xmlns" or key.startswith(("xmlns:", "xsi:", "xml:")):
                continue
            else:
                kept[_local(key)] = value
        position = self.here()
        element = Element(_local(name), kept, position, self._attribute_positions(position))
        if self._stack:
            self._stack[-1].children.append(element)
        else:
            self._root = element
        self._stack.append(element)

    def _end(self, _name: str) -> None:
        self._stack.pop()

    def _characters(self, text: str) -> None:
        if self._stack:
            self._stack[-1].text += text

    def _attribute_positions(self, start: Position) -> dict[str, Position]:
        """Where each attribute's value starts, by scanning the start tag's own text."""
        begin = self._expat.CurrentByteIndex
        text = self._tag_text(begin)
        positions: dict[str, Position] = {}
        name = _NAME.match(text)
        match = _ATTRIBUTE.match(text, name.end()) if name is not None else None
        while match is not None:
            group = 2 if match.group(2) is not None else 3
            before = text[: match.start(group)]
            lines = before.count("\n")
            column = len(before) - (before.rfind("\n") + 1) + 1
            if not lines:
                column += start.column - 1
            positions[_local(match.group(1))] = Position(self._file, start.line + lines, column)
            match = _ATTRIBUTE.match(text, match.end())
        return positions

    def _tag_text(self, begin: int) -> str:
        """The start tag at byte ``begin``: up to the ``>`` that stands in no attribute value."""
        quote = b""
        for found in _TAG_MARKS.finditer(self._content, begin):
            mark = found.group()
            if quote:
                quote = b"" if mark == quote else quote
            elif mark == b">":
                return self._content[begin : found.end()].decode("utf-8", "replace")
            else:
                quote = mark
        return ""


def _local(name: str) -> str:
    return name.rpartition(":")[2]
