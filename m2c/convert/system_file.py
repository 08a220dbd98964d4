"""A system file that names the converted models."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path

from lxml import etree

from m2c.convert.trees import document, drop_prefixes, elements, with_root
from m2c.diagnostics import DiagnosticLog
from m2c.model.inputs import resolve
from m2c.model.loading import current_input_type
from m2c.model.system import SYSTEM_ROOT, SYSTEM_ROOTS
from m2c.model.xml import Element

CURRENT_TAGS = {"mc_parameters": "parameters"}
_REFERENCES = ("src", "path")
"""Attributes that name a file or folder."""


def converted_system_file(
    tree: etree._Element,
    read: Element,
    path: Path,
    to: Path,
    moved: Mapping[Path, Path],
    interfaces: Sequence[Path],
) -> str:
    """The system file ``tree`` as a text.

    Args:
        tree: of the file, with comments; it is changed.
        read: the same without comments, and with places.
        path: where it was read from.
        to: where it will stand.
        moved: where each converted model will stand, by its path; all absolute.
        interfaces: folders that it uses without naming them; they are named then.
    """
    drop_prefixes(tree)
    is_full_model = tree.tag not in SYSTEM_ROOTS
    for node, element in zip(elements(tree), _elements(read), strict=True):
        for attribute in _REFERENCES:
            if node.get(attribute, "").strip():
                node.set(attribute, _moved(element, attribute, path.parent, to.parent, moved))
        if is_full_model:
            continue
        node.tag = CURRENT_TAGS.get(str(node.tag), node.tag)
        if node.tag == "input" and "type" in node.attrib:
            node.set("type", current_input_type(node.get("type", "").strip()))
        elif node.tag == "topic":
            _name_durability(node)
    if interfaces and not is_full_model:
        _name_interfaces(tree, [_relative(folder, to.parent) for folder in interfaces])
    return document(tree, with_root(tree, str(tree.tag) if is_full_model else SYSTEM_ROOT))


def _elements(element: Element) -> list[Element]:
    found = [element]
    for child in element.children:
        found += _elements(child)
    return found


def _moved(
    element: Element, attribute: str, folder: Path, to: Path, moved: Mapping[Path, Path]
) -> str:
    """Where the file that ``element`` names is, from the folder ``to``."""
    written = element.get(attribute)
    if "://" in written or (os.path.isabs(written) and _real(Path(written)) not in moved):
        return written
    silent = DiagnosticLog()
    found = resolve(folder, written, element, silent)
    if found is None:
        found = resolve(folder, written, element, silent, wants_folder=True)
    real = _real(found or folder / written)
    return _relative(moved.get(real, real), to)


def _real(path: Path) -> Path:
    """``path`` without links; :meth:`Path.resolve` raises where they lead in a circle."""
    return Path(os.path.realpath(path))


def _relative(path: Path, folder: Path) -> str:
    written = Path(os.path.relpath(path, folder)).as_posix()
    return written if written.startswith("../") else f"./{written}"


def _name_durability(node: etree._Element) -> None:
    """``latched="true"``, as ROS 1 said, is a durability."""
    if node.attrib.pop("latched", "").strip() == "true":
        node.set("durability", "transient_local")


def _name_interfaces(tree: etree._Element, folders: Sequence[str]) -> None:
    above = tree.find("interfaces")
    if above is None:
        last = tree[-1]  # no system is empty
        above = etree.SubElement(tree, "interfaces")
        above.tail, last.tail = last.tail, tree.text
    named = {node.get("src") for node in above}
    for folder in folders:
        if folder not in named:
            etree.SubElement(above, "input", {"type": "ros-interfaces", "src": folder})
