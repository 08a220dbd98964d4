"""Where the start tags and attribute values of an XML text stand, found in one pass over it.

A tree of lxml knows the line of an element and nothing of its attributes. So this pass goes over the
text first: the n-th tag it finds is the n-th element of the tree. It also bounds what lxml is given
(depth, elements, attributes; no document type, hence no entities), and refuses with its exact place
whatever it cannot follow: then nothing after that place could be told. After a ``<`` or an ``&`` that is
not escaped, or an element that is not ended before one around it, it can be told what was meant: reading
goes on there (:class:`Mended`).

Every repetition in its expressions is possessive, so none of them backtracks and the work is
proportional to the text. Grammar: https://www.w3.org/TR/xml/; names are taken more generously than
there, lxml is the judge of them.
"""

from __future__ import annotations

import difflib
import re
from typing import NoReturn

import msgspec

from m2c.diagnostics import shortened
from m2c.model.xml_fault import MalformedXml, XmlFault, hostile, malformed, place_of

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
_BROKEN_ATTRIBUTE = re.compile(
    rf"{_BLANK}++({_NAME}){_BLANK}*+={_BLANK}*+((?:{_DOUBLE}|{_SINGLE})?+)\Z"
)
"""All of that, if it is an attribute whose value has no opening, or no closing, quote."""
_TAG = re.compile(rf"<{_NAME}")
_BROKEN_END = re.compile(rf"</(?:{_NAME}{_BLANK}*+)?+")

MOST_MENDED = 20
"""After so many faults of one file reading ends: it is something else than was taken for it."""
_ESCAPES = {"<": "&lt;", "&": "&amp;"}
_TEXT_IN = {'"': "'", "'": '"'}
"""The quotes of a value, and those of texts in it."""
_UNCLOSED = "unclosed token"
_JUNK = "junk after document element"
_ALIKE = 0.8
"""From here on one name is the other one misspelt (``difflib``'s measure, from 0 to 1)."""
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


class Mended:
    """The faults of a text after which reading went on, and the text as it was meant.

    Attributes:
        faults: in their order, one a line at most.
    """

    def __init__(self) -> None:
        self.faults: list[XmlFault] = []
        self._edits: list[tuple[int, int, str]] = []

    def add(self, fault: MalformedXml, offset: int, length: int, meant: str) -> None:
        """``meant`` belongs in the place of the ``length`` characters at ``offset``."""
        self.note(fault)
        self._edits.append((offset, length, meant))

    def note(self, fault: XmlFault) -> None:
        """``fault`` was found; it is told if it is the first in its line."""
        if not self.faults or self.faults[-1].line != fault.line:
            self.faults.append(fault)

    @property
    def is_full(self) -> bool:
        """Whether no more is mended."""
        return len(self._edits) >= MOST_MENDED

    def meant(self, text: str) -> str:
        """``text``, mended."""
        for offset, length, meant in sorted(self._edits, reverse=True):
            text = text[:offset] + meant + text[offset + length :]
        return text


def start_tags(text: str, begin: int = 0, mended: Mended | None = None) -> list[StartTag]:
    """The start tags of ``text`` from ``begin`` on, in its order.

    Args:
        text: the document.
        begin: where it begins.
        mended: gets the faults after which reading goes on; None: it ends with the first.

    Raises:
        XmlFault: ``text`` is hostile, or no XML that this pass can follow.
    """
    return _Pass(text, mended).run(begin)


class _Unescaped(MalformedXml):
    """A character that has to be escaped; ``offset``: its place."""

    offset = 0


class _Pass:
    def __init__(self, text: str, mended: Mended | None) -> None:
        self._text = text
        self._mended = mended
        self._open: list[StartTag] = []
        self._tags: list[StartTag] = []

    def run(self, at: int) -> list[StartTag]:
        first: _Unescaped | None = None
        """What was mended in the markup that is read now."""
        while True:
            text = self._text
            between = (_INSIDE if self._open else _OUTSIDE).match(text, at)
            assert between is not None  # it matches nothing, too
            at = between.end()
            if at == len(text):
                break
            try:
                if text.startswith("</", at):
                    at = self._end(at)
                elif text[at] == "<" and text[at + 1 : at + 2] not in ("!", "?"):
                    at = self._start(at)
                else:
                    self._refuse_markup(at)
                first = None
            except _Unescaped as fault:
                first = first or fault
                if not self._open and fault.offset == at:  # no element has begun
                    raise
                self._mend(fault, first)
            except MalformedXml:
                if first is not None:  # it was not what it was taken for
                    raise first from None
                raise
        if self._open or not self._tags:
            inner = _shown(self._open[-1].name) if self._open else ""
            hint = f"write </{inner}> where it ends" if inner else ""
            self._malformed(at, "the document ends" if self._tags else "no element", hint)
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
            self._open.append(self._tags[-1])
        return close.end()

    def _end(self, at: int) -> int:
        """Take in the end tag at ``at``; where it ends."""
        if not self._open:
            self._refuse_markup(at)
        end = _END.match(self._text, at)
        if end is None:
            self._refuse_token(_BROKEN_END, at, at)
        if end[1] != self._open[-1].name:
            fault = self._fault(
                end.start(1), f"mismatched tag </{_shown(end[1])}>", self._which(end[1])
            )
            self._end_before(at, end[1], fault)
        self._open.pop()
        return end.end()

    def _end_before(self, at: int, name: str, fault: MalformedXml) -> None:
        """End what is open within an element ``name``, which ends at ``at``; ``fault`` if there is none."""
        mended = self._mended
        if mended is None or mended.is_full or all(tag.name != name for tag in self._open):
            raise fault
        ends = ""
        while self._open[-1].name != name:
            ends += f"</{self._open.pop().name}>"
        mended.add(fault, at, 0, ends)

    def _mend(self, fault: _Unescaped, first: _Unescaped) -> None:
        """Read on as if the character had been escaped; ``first``: what is told of its markup."""
        mended, offset = self._mended, fault.offset
        if mended is None or mended.is_full:
            raise first
        mended.add(first, offset, 1, _ESCAPES[self._text[offset]])
        self._text = f"{self._text[:offset]} {self._text[offset + 1 :]}"

    def _which(self, name: str) -> str:
        """What would be right where ``</name>`` ends another element than the one that is open."""
        inner = self._open[-1].name
        if any(tag.name == name for tag in self._open):
            return f"write </{_shown(inner)}> before it"
        if difflib.SequenceMatcher(None, inner[:_MAX_SHOWN], name[:_MAX_SHOWN]).ratio() >= _ALIKE:
            return "one of the two is misspelt"
        return f"</{_shown(inner)}> is due"

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
        quote = self._text[begin - 1]
        if reached.end() == begin and quote in _TEXT_IN:
            *_, last = _ATTRIBUTE.finditer(self._text, at, begin)
            what = f"the value of `{_shown(last[1])}` ends with the {quote} before this"
            hint = f"write a text in the value with {_TEXT_IN[quote]}, and a blank after the value"
            self._malformed(begin, what, hint)
        attribute = _BROKEN_ATTRIBUTE.match(self._text, begin, reached.end())
        if attribute is not None and not attribute[2]:
            self._malformed(reached.end(), "a value without quotes", 'write it like name="value"')
        if attribute is not None and self._is_next_tag(attribute[2], reached.end()):
            what = f"the value of `{_shown(attribute[1])}` does not end"
            self._malformed(attribute.start(2), what, f"write {attribute[2][0]} after it")
        self._invalid(reached.end(), attribute[1] if attribute is not None else "")

    def _is_next_tag(self, value: str, at: int) -> bool:
        """Whether a tag begins at ``at``, as ``value`` before it was not ended; else it is an operator."""
        text = self._text
        written = value.rstrip(" \t\n")
        blank = value[len(written) :]
        if text.startswith(("</", "<!"), at):
            return True
        return _TAG.match(text, at) is not None and (written[-1:] == ">" or "\n" in blank)

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

    def _invalid(self, at: int, attribute: str = "") -> NoReturn:
        """The character at ``at``, in the value of ``attribute`` if it stands in one, may not stand there."""
        if _ENTITY.match(self._text, at):
            self._malformed(at, "undefined entity")
        escape = _ESCAPES.get(self._text[at], "")
        if not escape:
            self._malformed(at, "not well-formed (invalid token)")
        raw = "&&" if self._text.startswith("&&", at) else self._text[at]
        hint = f"write {escape} for {raw[0]}" + (f": {escape * 2}" if raw == "&&" else "")
        if attribute:
            what = f"a raw {raw} in the value of `{_shown(attribute)}`"
            fault = malformed(self._text, at, what, hint)
        else:
            fault = self._fault(at, "not well-formed (invalid token)", hint)
        unescaped = _Unescaped(fault.line, fault.column, fault.message, fault.hint)
        unescaped.offset = at
        raise unescaped

    def _malformed(self, at: int, reason: str, hint: str = "") -> NoReturn:
        raise self._fault(at, reason, hint)

    def _fault(self, at: int, reason: str, hint: str) -> MalformedXml:
        opened = ""
        if self._open:
            inner = self._open[-1]
            line, column = place_of(self._text, inner.offset)
            opened = f"; <{_shown(inner.name)}> of {line}:{column} is open"
        return malformed(self._text, at, f"{reason}{opened}", hint)


def _shown(name: str) -> str:
    return shortened(name, _MAX_SHOWN)
