"""Reading XML that may be hostile, keeping the exact place of every element and attribute.

lxml makes the tree, and judges whether the text is XML; where things stand in it is found beforehand
(:mod:`m2c.model.xml_places`), with bounds on what lxml is given. No document type, so no entities;
no network. Names are compared without their prefix: real model files carry ``xmlns="..."``, another's
namespace, or prefixes that nobody declared. What is of another declared namespace than the root is left out.
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

_XSI = "http://www.w3.org/2001/XMLSchema-instance"
_XML = "http://www.w3.org/XML/1998/namespace"
"""Whose attributes say nothing about a model."""

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
        names = _Names(tree, log)
        root = _elements_of(tree, tags, places, names)
    except MalformedXml as fault:
        if not mended.faults:  # else it may be of what is not there
            _report((fault,), file, log)
        return None
    names.note()
    namespace = _namespace(tree.tag)
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


class _Names:
    """Which names of a document are its own, and what is said of the others: once for all of them.

    Those of the root's namespace are, those of SCXML's, those without one, and those of an undeclared prefix;
    of attributes with such a prefix those whose element has it, too.
    """

    def __init__(self, tree: etree._Element, log: DiagnosticLog) -> None:
        self._own = {"", SCXML_NAMESPACE, _namespace(tree.tag)}
        self._log = log
        self._prefixes: dict[str, tuple[Position, str]] = {}
        self._foreign: tuple[Position, str] | None = None

    def is_own(self, name: str, written: str, at: Position, of_another: bool = False) -> bool:
        """Whether ``name``, as lxml has it and as it is ``written``, is one.

        ``of_another``: it has an undeclared prefix, and its element has not.
        """
        if _namespace(name) in self._own and not of_another:
            return True
        self._foreign = self._foreign or (at, written)
        return False

    def undeclared(self, node: etree._Element, written: str, at: Position) -> None:
        """Remember the prefix of an element if nobody declared it."""
        prefix = written.rpartition(":")[0]
        if prefix and not _namespace(node.tag):
            self._prefixes.setdefault(prefix, (at, written))

    def note(self) -> None:
        """Note what is left out, and each undeclared prefix."""
        for at, written in self._prefixes.values():
            name = shortened(_local(written), _MAX_SHOWN)
            what = f"`{shortened(written, _MAX_SHOWN)}` is read as `{name}`"
            hint = "names are read without an undeclared prefix"
            self._log.note("older-spelling", at, name, what, hint)
        if self._foreign is not None:
            at, written = self._foreign
            what = f"`{shortened(written, _MAX_SHOWN)}` is of another namespace: all such markup is ignored"
            self._log.note("ignored-element", at, "", what)


def _is_of_another(attribute: str, element: str) -> bool:
    """Whether ``attribute`` has an undeclared prefix that ``element`` has not; ``xsi`` needs none."""
    prefix = "" if _namespace(attribute) else attribute.rpartition(":")[0]
    return prefix not in ("", "xsi", element.rpartition(":")[0])


def _namespace(name: str | bytes | bytearray | etree.QName) -> str:
    """The namespace of a name as lxml has it, ``{namespace}name``; "" without one."""
    return str(name).rpartition("}")[0].removeprefix("{")


def tree_with_comments(content: bytes) -> etree._Element:
    """The tree of ``content``, for who writes it again: with comments and processing instructions.

    It has no elements and attributes of other namespaces.

    Raises:
        XmlFault: :func:`parse_xml` refuses it.
    """
    text = decoded(content)
    begin = len(text) - len(text.lstrip(_BLANKS))
    start_tags(text, begin)
    tree = _parsed(text, begin, comments=True)
    own = {"", SCXML_NAMESPACE, _namespace(tree.tag)}
    for node in list(tree.iter(etree.Element)):
        if _namespace(node.tag) not in own:
            _left_out(node)
        for name in map(str, list(node.attrib)):
            is_own = _namespace(name) in (*own, _XSI, _XML)
            if not is_own or _is_of_another(name, str(node.tag)):
                del node.attrib[name]
    return tree


def _left_out(node: etree._Element) -> None:
    """Take ``node`` out of its tree, but for the text behind it."""
    above, before = node.getparent(), node.getprevious()
    if above is None:
        return
    if before is not None:
        before.tail = (before.tail or "") + (node.tail or "")
    else:
        above.text = (above.text or "") + (node.tail or "")
    above.remove(node)


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
    if reason.startswith("Double hyphen"):
        hint = "XML has no -- within a comment; write = or a blank"
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


def _elements_of(
    tree: etree._Element, tags: Sequence[StartTag], places: _Places, names: _Names
) -> Element:
    """``tree`` with the places of ``tags``, whose n-th is the n-th element's, without what is not its own.

    Raises:
        MalformedXml: they do not agree, so that a place would be a wrong one.
    """
    found: dict[etree._Element, Element] = {}
    for tag, node in zip_longest(tags, tree.iter()):
        if tag is None or node is None or not _agree(tag, node):
            at = places.at(tag.offset if tag is not None else tags[-1].offset)
            what = "malformed XML: which element this is is not clear"
            raise MalformedXml(at.line, at.column, what)
        above = node.getparent()
        if above is not None and above not in found:
            continue  # it is in what is left out
        at = places.at(tag.offset)
        if not names.is_own(str(node.tag), tag.name, at):
            continue
        names.undeclared(node, tag.name, at)
        element = _element(tag, node, places, names)
        found[node] = element
        if above is not None:
            found[above].children.append(element)
    return found[tree]


def _element(tag: StartTag, node: etree._Element, places: _Places, names: _Names) -> Element:
    attributes: dict[str, str] = {}
    positions: dict[str, Position] = {}
    for name, (key, value) in zip(_own_names(tag), node.attrib.items(), strict=True):
        local, at = _local(name), places.at(tag.attributes[name])
        if name.startswith(("xsi:", "xml:")) or _namespace(key) in (_XSI, _XML):
            continue
        is_undeclared = _is_of_another(str(key), tag.name)
        if not names.is_own(str(key), name, at, is_undeclared):
            continue
        if local != name and local in tag.attributes:
            continue
        attributes[local] = str(value)
        positions[local] = at
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
