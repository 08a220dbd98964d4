"""Where the start tags and attribute values of an XML text stand, found in one pass over it.

A tree of lxml knows the line of an element and nothing of its attributes. So this pass goes over the
text first: the n-th tag it finds is the n-th element of the tree. It also bounds what lxml is given
(depth, elements, attributes; no document type, hence no entities), and refuses with its exact place
whatever it cannot follow: then nothing after that place could be told.

Every repetition in its expressions is possessive, so none of them backtracks and the work is
proportional to the text. Grammar: https://www.w3.org/TR/xml/; names are taken more generously than
there, lxml is the judge of them.
"""

from __future__ import annotations

import re
from typing import NoReturn

import msgspec

from m2c.model.diagnostics import shortened
from m2c.model.xml_fault import hostile, malformed

MAX_DEPTH = 64
"""Executable content nests a handful deep; the bound keeps every later walk recursion-safe."""
MAX_ELEMENTS = 50_000
MAX_ATTRIBUTES = 100
"""A hundred times what published models have: bounds the work of every later check."""

_FORBIDDEN = "\x00-\x08\x0b\x0c\x0e-\x1f\ufffe\uffff"
"""Characters that XML 1.0 does not have (2.2), as part of a set of a regular expression."""
_BLANK = r"[ \t\n]"
_NAME = rf"[^\s<>/='\"&!?{_FORBIDDEN}][^\s<>/='\"&{_FORBIDDEN}]*+"
_REFERENCE = r"&(?:amp|lt|gt|quot|apos|#[0-9]++|#x[0-9A-Fa-f]++);"
_DOUBLE = rf"\"(?:[^\"<&{_FORBIDDEN}]++|{_REFERENCE})*+"
_SINGLE = rf"'(?:[^'<&{_FORBIDDEN}]++|{_REFERENCE})*+"
"""A value up to its closing quote, or to what may not stand in it."""
_VALUE = rf"(?:{_DOUBLE}\"|{_SINGLE}')"
_ASIDE = r"<!--.*?-->|<\?.*?\?>"

_OUTSIDE = re.compile(rf"(?:{_BLANK}++|{_ASIDE})*+", re.DOTALL)
"""What may stand before and after the root."""
_INSIDE = re.compile(
    rf"(?:[^<&{_FORBIDDEN}]++|{_REFERENCE}|{_ASIDE}|<!\[CDATA\[.*?\]\]>)*+", re.DOTALL
)
"""What may stand between the tags of the root."""
_ATTRIBUTE = re.compile(rf"{_BLANK}++({_NAME}){_BLANK}*+={_BLANK}*+({_VALUE})")
_START = re.compile(rf"<({_NAME})(?:{_BLANK}++{_NAME}{_BLANK}*+={_BLANK}*+{_VALUE})*+")
_CLOSE = re.compile(rf"{_BLANK}*+(/?)>")
_END = re.compile(rf"</({_NAME}){_BLANK}*+>")
_DOCTYPE = re.compile(r"<!DOCTYPE\s*+([^\s\[>]*+)[^\[>]*+")
_ENTITY = re.compile(r"&[^\s<>&;#]++;")

_BROKEN_START = re.compile(
    rf"(?:{_BLANK}*+/|{_BLANK}++(?:{_NAME}(?:{_BLANK}*+=(?:{_BLANK}*+(?:{_DOUBLE}|{_SINGLE})?+)?+)?+)?+)?+"
)
"""After the attributes of a start tag that goes wrong: up to the character that is wrong."""
_BROKEN_END = re.compile(rf"</(?:{_NAME}{_BLANK}*+)?+")

_UNCLOSED = "unclosed token"
_JUNK = "junk after document element"
_MAX_SHOWN = 80
"""Characters of a name that a message repeats."""


class StartTag(msgspec.Struct, frozen=True):
    """A start tag; offsets count the characters of the text.

    Attributes:
        name: of the element, with its prefix.
        offset: of ``<``.
        attributes: names (with their prefixes) in their order, and the offset of each one's value.
    """

    name: str
    offset: int
    attributes: dict[str, int]


def start_tags(text: str, begin: int = 0) -> list[StartTag]:
    """The start tags of ``text`` from ``begin`` on, in its order.

    Raises:
        XmlFault: ``text`` is hostile, or no XML that this pass can follow.
    """
    return _Pass(text).run(begin)


class _Pass:
    def __init__(self, text: str) -> None:
        self._text = text
        self._open: list[str] = []
        self._tags: list[StartTag] = []

    def run(self, at: int) -> list[StartTag]:
        text = self._text
        while True:
            between = (_INSIDE if self._open else _OUTSIDE).match(text, at)
            assert between is not None  # it matches nothing, too
            at = between.end()
            if at == len(text):
                break
            if text.startswith("</", at):
                at = self._end(at)
            elif text[at] == "<" and text[at + 1 : at + 2] not in ("!", "?"):
                at = self._start(at)
            else:
                self._refuse_markup(at)
        if self._open or not self._tags:
            self._malformed(at, "the document ends" if self._tags else "no element")
        return self._tags

    def _start(self, at: int) -> int:
        """Take in the start tag at ``at``; where it ends."""
        text = self._text
        if self._tags and not self._open:
            self._malformed(at, _JUNK)
        start = _START.match(text, at)
        if start is None and at + 1 == len(text):
            self._malformed(at, _UNCLOSED)
        if start is None:
            self._invalid(at)
        close = _CLOSE.match(text, start.end())
        if close is None:
            self._refuse_token(_BROKEN_START, start.end(), at)
        name = start[1]
        self._bound(at)
        attributes: dict[str, int] = {}
        for found in _ATTRIBUTE.finditer(text, start.end(1), start.end()):
            if len(attributes) == MAX_ATTRIBUTES:
                self._too_many(at, MAX_ATTRIBUTES, "attributes in an element")
            if found[1] in attributes:
                self._malformed(found.start(1), "duplicate attribute")
            attributes[found[1]] = found.start(2) + 1
        self._tags.append(StartTag(name, at, attributes))
        if not close[1]:
            self._open.append(name)
        return close.end()

    def _end(self, at: int) -> int:
        """Take in the end tag at ``at``; where it ends."""
        if not self._open:
            self._refuse_markup(at)
        end = _END.match(self._text, at)
        if end is None:
            self._refuse_token(_BROKEN_END, at, at)
        if end[1] != self._open[-1]:
            self._malformed(end.start(1), "mismatched tag")
        self._open.pop()
        return end.end()

    def _bound(self, at: int) -> None:
        if len(self._open) >= MAX_DEPTH:
            what = f"elements are nested more than {MAX_DEPTH} deep"
            raise hostile(self._text, at, what, "a model is a few levels deep")
        if len(self._tags) >= MAX_ELEMENTS:
            self._too_many(at, MAX_ELEMENTS, "elements")

    def _too_many(self, at: int, most: int, what: str) -> NoReturn:
        raise hostile(
            self._text, at, f"more than {most} {what}", "a model has a few hundred elements"
        )

    def _refuse_token(self, broken: re.Pattern[str], begin: int, at: int) -> NoReturn:
        """The tag at ``at`` goes wrong after ``begin``: where ``broken`` ends."""
        reached = broken.match(self._text, begin)
        assert reached is not None  # it matches nothing, too
        if reached.end() == len(self._text):
            self._malformed(at, _UNCLOSED)
        self._invalid(reached.end())

    def _refuse_markup(self, at: int) -> NoReturn:
        """No tag begins at ``at``, and nothing else that may stand there."""
        text = self._text
        doctype = _DOCTYPE.match(text, at)
        if doctype is not None and not self._tags:
            what = f"a document type declaration (<!DOCTYPE {_shown(doctype[1])}…>) is refused"
            raise hostile(text, doctype.end(), what, "models need no entities; remove it")
        if text.startswith(("<!--", "<?", "<![CDATA["), at):
            self._malformed(at, _UNCLOSED)
        if self._tags and not self._open:
            self._malformed(at, _JUNK)
        self._invalid(at)

    def _invalid(self, at: int) -> NoReturn:
        """The character at ``at`` may not stand there."""
        if _ENTITY.match(self._text, at):
            self._malformed(at, "undefined entity")
        hint = {"<": "write &lt; for <", "&": "write &amp; for &"}.get(self._text[at], "")
        self._malformed(at, "not well-formed (invalid token)", hint)

    def _malformed(self, at: int, reason: str, hint: str = "") -> NoReturn:
        opened = f"; <{_shown(self._open[-1])}> is open" if self._open else ""
        raise malformed(self._text, at, f"{reason}{opened}", hint)


def _shown(name: str) -> str:
    return shortened(name, _MAX_SHOWN)
