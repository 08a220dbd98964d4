"""XML trees that are read with their comments, and written again."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from lxml import etree

_XML = "http://www.w3.org/XML/1998/namespace"
_DECLARATION = '<?xml version="1.0" encoding="UTF-8"?>'


def elements(tree: etree._Element) -> Iterator[etree._Element]:
    """``tree`` and the elements in it, in document order, without comments."""
    return tree.iter(etree.Element)


def drop_prefixes(tree: etree._Element) -> None:
    """Give every element and attribute of ``tree`` the name that the reader knows it by.

    What the reader leaves out goes: attributes of XML Schema (``xsi:schemaLocation``).
    """
    for node in elements(tree):
        node.tag = _local(str(node.tag))
        attributes = [(str(name), value) for name, value in node.attrib.items()]
        node.attrib.clear()
        for name, value in attributes:
            if name.startswith(f"{{{_XML}}}"):
                node.set(name, value)
            elif not name.startswith(("xsi:", "{http://www.w3.org/2001/XMLSchema-instance}")):
                node.set(_local(name), value)


def with_root(tree: etree._Element, tag: str, namespace: str = "") -> etree._Element:
    """``tree``, whose names have no prefixes, under a root called ``tag`` and in one ``namespace``."""
    nsmap: dict[Any, str] | None = {None: namespace} if namespace else None  # None: no prefix
    for node in elements(tree):
        node.tag = f"{{{namespace}}}{node.tag}" if namespace else node.tag
    root = etree.Element(f"{{{namespace}}}{tag}" if namespace else tag, nsmap=nsmap)
    for name, value in tree.attrib.items():
        root.set(name, value)
    root.text = tree.text
    root.extend(list(tree))
    etree.cleanup_namespaces(root)
    return root


def document(tree: etree._Element, root: etree._Element) -> str:
    """The text of ``root``, with the comments that stand before and after ``tree``."""
    before = reversed(list(tree.itersiblings(preceding=True)))
    parts = [*before, root, *tree.itersiblings()]
    texts = [etree.tostring(part, encoding="unicode", with_tail=False) for part in parts]
    return "\n".join([_DECLARATION, *map(str, texts)]) + "\n"


def replace_tag(node: etree._Element, tag: str, attributes: dict[str, str]) -> None:
    """Make ``node`` a ``tag`` with ``attributes``, and leave what is in it."""
    node.tag = tag
    node.attrib.clear()
    for name, value in attributes.items():
        node.set(name, value)


def _local(name: str) -> str:
    return name.rpartition("}")[2].rpartition(":")[2]
