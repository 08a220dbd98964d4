"""XML that this project writes, and reads again: built as a tree, so that no text becomes markup."""

from __future__ import annotations

import re
from collections.abc import Mapping

from lxml import etree

from m2c.model.xml import hardened_parser

_FORBIDDEN = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters that XML 1.0 does not have (2.2), not even as references."""


def element(tag: str, attributes: Mapping[str, str], text: str = "") -> etree._Element:
    """An element ``tag`` without children.

    Args:
        tag: its name, which must be one of XML.
        attributes: values by name, in the order in which they are written.
        text: what stands in it.

    In values and text, U+FFFD (�) stands for each character that XML does not have.
    """
    made = etree.Element(tag, {name: writable(value) for name, value in attributes.items()})
    made.text = writable(text) or None
    return made


def below(
    parent: etree._Element, tag: str, attributes: Mapping[str, str], text: str = ""
) -> etree._Element:
    """A new last child of ``parent``; see :func:`element`."""
    made = element(tag, attributes, text)
    parent.append(made)
    return made


def serialised(root: etree._Element) -> str:
    """``root`` as text without an XML declaration, two blanks for each level, with a last line end."""
    etree.indent(root)
    return str(etree.tostring(root, encoding="unicode")) + "\n"


def read_back(text: str) -> etree._Element:
    """The tree of a ``text`` that :func:`serialised` made.

    Raises:
        lxml.etree.XMLSyntaxError: somebody else made it.
    """
    return etree.fromstring(text.encode(), hardened_parser())


def writable(text: str) -> str:
    """``text`` with U+FFFD for each character that XML 1.0 forbids (2.2, Char)."""
    return _FORBIDDEN.sub("�", text)
