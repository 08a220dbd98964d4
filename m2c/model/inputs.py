"""Files and folders that a system file refers to."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

from m2c.diagnostics import DiagnosticLog, Position, shortened
from m2c.model.paths import meant, why_no_file, why_no_folder
from m2c.model.xml import Element
from m2c.suggestions import nearest

_MAX_SHOWN = 200
"""Characters of a path that a message repeats."""


def resolve(
    folder: Path, source: str, element: Element, log: DiagnosticLog, *, wants_folder: bool = False
) -> Path | None:
    """The file ``source``, or with ``wants_folder`` the folder, relative to ``folder``.

    A path that differs from an existing one only by case is accepted with a warning: published
    systems were written on file systems that do not tell them apart.
    """
    at = element.at("src" if "src" in element.attributes else "path")
    if not source:
        what = "the attribute `src` is missing"
        log.error("missing-attribute", element.position, element.tag, what)
        return None
    path: Path | None = folder / source
    try:
        (folder / source).stat()
    except (FileNotFoundError, NotADirectoryError):
        path = _in_another_case(folder, source, element, at, log)
    except (OSError, ValueError):
        pass  # told below: a loop of links, a name that is too long
    if path is None:
        return None
    why = why_no_folder(path) if wants_folder else why_no_file(path)
    if why and wants_folder:
        log.error("missing-file", at, element.tag, f"this interface folder {why}")
    elif why:
        log.error("unreadable-file", at, element.tag, f"cannot read the file: {why}")
    return None if why else path


def _in_another_case(
    folder: Path, source: str, element: Element, at: Position, log: DiagnosticLog
) -> Path | None:
    current = folder
    for part in Path(source).parts:
        exact = current / part
        if part == ".." or os.path.exists(exact):
            current = exact
            continue
        near = [item for item in _entries(current) if item.name.lower() == part.lower()]
        if len(near) != 1:
            hint = meant(folder / source).replace(f"{folder}{os.sep}", "")
            hint = hint or nearest(part, (item.name for item in _entries(current)))
            what = f"{shortened(str(folder / source), _MAX_SHOWN)} does not exist"
            log.error("missing-file", at, element.tag, what, hint)
            return None
        current = near[0]
    log.warning(
        "path-case",
        at,
        element.tag,
        f"`{source}` is written {current} on disk",
        "use the same case",
    )
    return current


def _entries(folder: Path) -> Iterable[Path]:
    try:
        return list(folder.iterdir())
    except OSError:  # none, or not ours to look into
        return ()
