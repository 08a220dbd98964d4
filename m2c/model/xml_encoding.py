"""The text of an XML file: which encoding its bytes are in, and that they are (XML 1.0, appendix F)."""

from __future__ import annotations

import codecs
import re

from m2c.diagnostics import shortened
from m2c.model.xml_fault import MalformedXml, malformed, place_of

_MARKS = (
    (codecs.BOM_UTF8, "utf-8"),
    (codecs.BOM_UTF16_LE, "utf-16-le"),
    (codecs.BOM_UTF16_BE, "utf-16-be"),
)
_UNMARKED = ((b"<\0", "utf-16-le"), (b"\0<", "utf-16-be"))
"""How UTF-16 without a byte-order mark begins."""
_ALLOWED = re.compile(
    r"utf-?8|utf-?16(?:[-_]?[lb]e)?|(?:us-)?ascii|iso-8859-\d{1,2}|latin-?1|windows-125\d", re.I
)
"""Encodings in which text has one reading; others (UTF-7, say) hide markup from whoever looks."""
_DECLARED = re.compile(rb"\s*<\?xml\s[^>]*?\sencoding\s*=\s*[\"']([^\"'>]*)[\"']")
_HINT = "write the file in UTF-8"
_MAX_SHOWN = 40
"""Characters of an encoding's name that a message repeats."""


def decoded(content: bytes) -> str:
    """``content`` as text, without byte-order mark, lines ending in line feeds (XML 1.0, 2.11).

    Raises:
        MalformedXml: the declared encoding is not one that is read, or the bytes are not in it.
    """
    mark, encoding = next(((m, e) for m, e in _MARKS if content.startswith(m)), (b"", ""))
    body = content[len(mark) :]
    why = "which its byte-order mark names"
    if not encoding:
        encoding = next((e for start, e in _UNMARKED if body.startswith(start)), "")
        why = "in which it begins"
    if not encoding:
        encoding = _declared(body)
        declares = _DECLARED.match(body) is not None
        why = "which it declares" if declares else "which is read where none is declared"
    try:
        return _with_newlines(body.decode(encoding))
    except UnicodeDecodeError as error:
        before = _with_newlines(body[: error.start].decode(encoding))
        byte = (
            f"the byte 0x{body[error.start]:02x}, number {len(mark) + error.start + 1} of the file"
        )
        what = f"{byte}, is not {encoding.upper()}, {why}"
        raise malformed(before, len(before), what, _HINT) from None


def _declared(body: bytes) -> str:
    """The encoding of the XML declaration; UTF-8 if it names none."""
    found = _DECLARED.match(body)
    if found is None:
        return "utf-8"
    name = found[1].decode("ascii", "replace").strip()
    try:
        codec = codecs.lookup(name).name if _ALLOWED.fullmatch(name) else ""
    except LookupError:  # iso-8859-12, for one, was never made
        codec = ""
    before = body[: found.start(1)].decode("ascii", "replace")
    line, column = place_of(before, len(before))
    if not codec:
        what = f"unknown encoding: {shortened(name, _MAX_SHOWN)}"
        raise MalformedXml(line, column, what, _HINT)
    if codec.startswith("utf-16"):  # then the declaration could not have been read as ASCII
        what = f"the file declares {name}, and is not in it"
        raise MalformedXml(line, column, what, _HINT)
    return codec


def _with_newlines(text: str) -> str:
    return text.replace("\r\n", "\n").replace("\r", "\n")
