"""``<include path="…"/>``: one policy out of several files."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

from m2c.diagnostics import DiagnosticLog, shortened
from m2c.model.paths import meant, why_no_file
from m2c.model.structure import require
from m2c.model.xml import Element, read_xml

MAX_INCLUDES = 16
"""Files that include one another; real policies are one or two deep."""
_MAX_SHOWN = 200
"""Characters of a path that a message repeats."""


def elements_of(path: Path, root: Element, log: DiagnosticLog) -> list[Element]:
    """The children of ``root``, with those of the files it includes in place of each ``<include>``.

    A path is relative to the file it stands in. A file that is included twice is read once. What
    an included file says of the main tree does not count (as in BehaviorTree.CPP).

    Rules reported: ``missing-file``, ``recursive-include``, ``deep-include``, ``unknown-attribute``
    (``ros_pkg``), and those of :func:`m2c.model.xml.read_xml`.
    """
    return list(_Includes(log, path).elements(root, (path.resolve(),)))


def included_in(path: Path) -> set[Path]:
    """The policy at ``path``, the files that it includes, and those that it names and that are not there."""
    includes = _Includes(DiagnosticLog(), path)
    root = read_xml(path, DiagnosticLog())
    if root is not None:
        list(includes.elements(root, (path.resolve(),)))
    return includes.named


class _Includes:
    def __init__(self, log: DiagnosticLog, path: Path) -> None:
        self._log = log
        self._read = {path.resolve()}
        self.named = {path.resolve()}
        """Every file that was read, and those that could not be."""

    def elements(self, root: Element, above: tuple[Path, ...]) -> Iterator[Element]:
        for child in root.children:
            if child.tag != "include":
                yield child
                continue
            included = self._open(child, above)
            if included is not None:
                path, inner = included
                yield from self.elements(inner, (*above, path))

    def _open(self, element: Element, above: tuple[Path, ...]) -> tuple[Path, Element] | None:
        log = self._log
        for name in element.attributes:
            if name != "path" and not name.startswith("_"):  # an editor's
                hint = "write path=, relative to this file"
                what = f"`{name}` is not known here"
                log.error("unknown-attribute", element.at(name), element.tag, what, hint)
                return None
        written = require(element, "path", log)
        if not written:
            return None
        at = element.at("path")
        target = above[-1].parent / written
        self.named.add(target)
        if not os.path.lexists(target):
            what = f"the file {shortened(written, _MAX_SHOWN)} does not exist"
            hint = meant(target) or "the path is relative to the file that includes it"
            log.error("missing-file", at, element.tag, what, hint)
            return None
        why = why_no_file(target)
        if why:
            log.error("unreadable-file", at, element.tag, f"cannot read the file: {why}")
            return None
        path = target.resolve()
        if path in above:
            loop = " → ".join(item.name for item in (*above[above.index(path) :], path))
            what = f"a file cannot include itself: {loop}"
            log.error("recursive-include", at, element.tag, what)
            return None
        if len(above) >= MAX_INCLUDES:
            what = f"files are included more than {MAX_INCLUDES} deep"
            log.error("deep-include", at, element.tag, what)
            return None
        if path in self._read:
            return None
        self._read.add(path)
        root = read_xml(Path(element.position.file).parent / written, log)
        if root is None:
            return None
        if root.tag != "root":
            hint = "the root of a behaviour-tree policy is <root>"
            log.error("unknown-tag", root.position, root.tag, "not a policy", hint)
            return None
        return path, root
