"""Reading XML that may be hostile, keeping the exact place of every element and attribute.

lxml makes the tree, and judges whether the text is XML; where things stand in it is found beforehand
(:mod:`m2c.model.xml_places`), with bounds on what lxml is given. No document type, so no entities;
no network. Namespaces are not resolved: real model files carry ``xmlns="..."``, another's namespace
or prefixes that nobody declared, so names are compared without their prefix.
"""

from __future__ import annotations

import re
from array import array
from bisect import bisect_right
from collections.abc import Iterable, Iterator, Sequence
from itertools import chain, zip_longest
from pathlib import Path

from lxml import etree

from m2c.diagnostics import DiagnosticLog, Position, shortened
from m2c.model.file_size import size_of
from m2c.model.paths import meant
from m2c.model.xml_encoding import decoded
from m2c.model.xml_fault import HostileXml, MalformedXml, XmlFault, malformed
from m2c.model.xml_places import (
    MAX_ATTRIBUTES,
    MAX_DEPTH,
    MAX_ELEMENTS,
    Mended,
    StartTag,
    start_tags,
)

__all__ = [
    "MAX_ATTRIBUTES",
    "MAX_BYTES",
    "MAX_DEPTH",
    "MAX_ELEMENTS",
    "SCXML_NAMESPACE",
    "Element",
    "hardened_parser",
    "parse_xml",
    "read_xml",
    "tree_with_comments",
]

MAX_BYTES = 4 * 1024 * 1024
"""The largest published model has 40 kB; a hundred times that is not a model."""

SCXML_NAMESPACE = "http://www.w3.org/2005/07/scxml"

_BLANKS = " \t\n"
_BLANK = frozenset(_BLANKS)
_JSON_HINT = (
    "a JANI file has properties, a JSON Schema data types: "
    'name them in <properties> and in <data_declarations>, as type="json"'
)
_MAX_SHOWN = 200
"""Characters that are repeated of what may be as long as the file: a namespace, libxml2's messages."""


class Element:
    """An XML element: ``tag`` without prefix, ``attributes`` without namespace declarations.

    ``comment`` is what the comment directly before it says, where that may mean something: of ``data``.
    """

    __slots__ = ("_positions", "attributes", "children", "comment", "position", "tag", "text")

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
        self.comment = ""
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
        what = f"cannot read the file: {error.strerror}"
        log.error("unreadable-file", whole, "", what, meant(path))
        return None
    return parse_xml(content, file, log)


def parse_xml(content: bytes, file: str, log: DiagnosticLog) -> Element | None:
    """Parse ``content``, which messages call ``file``; see :func:`read_xml`.

    Where it can be told what was meant, it is read as that, and the log has an error: more is found at once.
    """
    mended = Mended()
    try:
        text = decoded(content)
        begin = len(text) - len(text.lstrip(_BLANKS))
        if begin == len(text):
            raise MalformedXml(1, 1, "the file is empty")
        if text.startswith("{", begin):
            raise malformed(text, begin, "no XML but JSON", _JSON_HINT)
        places = _Places(text, file)
        prologue = places.at(begin)
        if prologue.line > 1 and text.startswith("<?xml", begin):
            log.warning(
                "xml-prologue",
                prologue,
                "?xml",
                "blank lines before the XML declaration",
                "the declaration belongs at the very start of the file",
            )
        tags = start_tags(text, begin, mended)
    except XmlFault as fault:
        mended.note(fault)
        _report(mended.faults, file, log)
        return None
    _report(mended.faults, file, log)
    try:
        tree = _parsed(mended.meant(text), begin)
        root = _elements_of(tree, tags, places)
    except MalformedXml as fault:
        if not mended.faults:  # else it may be of what is not there
            _report((fault,), file, log)
        return None
    _note_prefixes(tags, places, log)
    namespace = tree.nsmap.get(None) or ""
    if namespace != SCXML_NAMESPACE and root.tag in ("scxml", "ascxml"):
        log.warning(
            "xml-namespace",
            root.position,
            root.tag,
            f'the namespace is "{shortened(namespace, _MAX_SHOWN)}"'
            if namespace
            else "no namespace is declared",
            f'xmlns="{SCXML_NAMESPACE}" is the standard\'s',
        )
    return root


def _report(faults: Iterable[XmlFault], file: str, log: DiagnosticLog) -> None:
    for fault in faults:
        at = Position(file, fault.line, fault.column)
        if isinstance(fault, HostileXml):
            log.error("hostile-xml", at, "", fault.message, fault.hint)
        else:
            log.error("malformed-xml", at, "", fault.message, fault.hint)


def _note_prefixes(tags: Sequence[StartTag], places: _Places, log: DiagnosticLog) -> None:
    """Note each prefix of elements once: names are read without it."""
    seen = {""}
    for tag in tags:
        prefix = tag.name.rpartition(":")[0]
        if prefix not in seen:
            seen.add(prefix)
            written, name = shortened(tag.name, _MAX_SHOWN), shortened(_local(tag.name), _MAX_SHOWN)
            what = f"`{written}` is read as `{name}`"
            at = places.at(tag.offset)
            log.note("older-spelling", at, name, what, "names are read without their prefix")


def tree_with_comments(content: bytes) -> etree._Element:
    """The tree of ``content``, for who writes it again: with comments and processing instructions.

    Raises:
        XmlFault: :func:`parse_xml` refuses it.
    """
    text = decoded(content)
    begin = len(text) - len(text.lstrip(_BLANKS))
    start_tags(text, begin)
    return _parsed(text, begin, comments=True)


def hardened_parser(*, recover: bool = False, comments: bool = False) -> etree.XMLParser:
    """A parser of UTF-8 that resolves no entity, opens no other file and keeps libxml2's bounds.

    Args:
        recover: go on after an error, which then stands in the parser's ``error_log`` only.
        comments: keep comments and processing instructions.
    """
    return etree.XMLParser(
        encoding="utf-8",
        recover=recover,
        resolve_entities=False,
        no_network=True,
        load_dtd=False,
        huge_tree=False,
        remove_comments=not comments,
        remove_pis=not comments,
    )


def _parsed(text: str, begin: int, *, comments: bool = False) -> etree._Element:
    """The tree of ``text`` from ``begin`` on; an undeclared prefix is the one fault that is forgiven.

    Raises:
        MalformedXml: libxml2 finds another.
    """
    parser = hardened_parser(recover=True, comments=comments)
    content = text[begin:]
    try:
        tree = etree.fromstring(content.encode(), parser)
    except etree.XMLSyntaxError:  # nothing could be made of it; its log says why
        tree = None
    for entry in parser.error_log.filter_from_errors():
        if entry.type != etree.ErrorTypes.NS_ERR_UNDEFINED_NAMESPACE:
            raise _fault(entry, text, begin)
    if tree is None:
        raise malformed(text, begin, "no element")
    return tree


def _fault(entry: etree._LogEntry, text: str, begin: int) -> MalformedXml:
    """What libxml2 found in ``text`` from ``begin`` on; its lines and columns count from there."""
    line_start = begin
    for _ in range(entry.line - 1):
        line_start = text.find("\n", line_start) + 1 or len(text)
    offset = min(line_start + max(entry.column - 1, 0), len(text))
    reason = " ".join(entry.message.split())
    if reason.startswith("xmlParseCharRef"):  # libxml2 has read it when it finds that it is none
        offset, reason = text.rfind("&", 0, offset), "reference to invalid character number"
    declared = text.startswith("<?xml ", begin) and offset <= text.find("?>", begin)
    hint = 'write <?xml version="1.0" encoding="UTF-8"?>' if declared else ""
    return malformed(text, offset, shortened(reason, _MAX_SHOWN), hint)


class _Places:
    """Offsets in ``text`` as positions in ``file``."""

    def __init__(self, text: str, file: str) -> None:
        self._text = text
        self._file = file
        ends = (found.end() for found in re.finditer("\n", text))
        self._starts = array("L", chain((0,), ends))

    def at(self, offset: int) -> Position:
        line = bisect_right(self._starts, offset)
        return Position(self._file, line, offset - self._starts[line - 1] + 1)

    def comment_before(self, offset: int) -> str:
        """What the comment that ends before ``offset`` says; "" if there is none."""
        end = offset
        while self._text[end - 1 : end] in _BLANK:
            end -= 1
        if not self._text.endswith("-->", 0, end):
            return ""
        begin = self._text.rfind("<!--", 0, end)
        return self._text[begin + 4 : end - 3].strip()


def _elements_of(tree: etree._Element, tags: Sequence[StartTag], places: _Places) -> Element:
    """``tree`` with the places of ``tags``, whose n-th is the n-th element's.

    Raises:
        MalformedXml: they do not agree, so that a place would be a wrong one.
    """
    found: dict[etree._Element, Element] = {}
    for tag, node in zip_longest(tags, tree.iter()):
        if tag is None or node is None or not _agree(tag, node):
            at = places.at(tag.offset if tag is not None else tags[-1].offset)
            what = "malformed XML: which element this is is not clear"
            raise MalformedXml(at.line, at.column, what)
        element = _element(tag, node, places)
        found[node] = element
        above = node.getparent()
        if above is not None:
            found[above].children.append(element)
    return found[tree]


def _element(tag: StartTag, node: etree._Element, places: _Places) -> Element:
    attributes: dict[str, str] = {}
    positions: dict[str, Position] = {}
    for name, value in zip(_own_names(tag), node.attrib.values(), strict=True):
        if not name.startswith(("xsi:", "xml:")):
            attributes[_local(name)] = str(value)
            positions[_local(name)] = places.at(tag.attributes[name])
    element = Element(_local(tag.name), attributes, places.at(tag.offset), positions)
    if element.tag == "data":
        element.comment = places.comment_before(tag.offset)
    element.text = "".join([node.text or "", *(child.tail or "" for child in node)])
    return element


def _own_names(tag: StartTag) -> list[str]:
    """The attributes that are no namespace declarations."""
    return [name for name in tag.attributes if name != "xmlns" and not name.startswith("xmlns:")]


def _agree(tag: StartTag, node: etree._Element) -> bool:
    """Whether ``node`` is what ``tag`` starts; lxml writes a declared prefix as ``{…}``."""
    names = [tag.name, *_own_names(tag)]
    return list(map(_local, names)) == [
        _local(str(name).rpartition("}")[2]) for name in (node.tag, *node.attrib)
    ]


def _local(name: str) -> str:
    return name.rpartition(":")[2]
