"""Paths that somebody wrote: what stands there, without a hang and without more than one reason."""

from __future__ import annotations

import difflib
import errno
import itertools
import os
from pathlib import Path

from m2c.model.file_size import size_of

MAX_ENTRIES = 100_000
"""Files and folders below one that is searched: ROS 2's own packages have a tenth of that."""
_MOST_COMPARED = 1000
_MAX_COMPARED = 255
"""Entries of a folder, and characters of a name, that are compared with what was written."""
_TOO_LARGE = f"has more than {MAX_ENTRIES} files below it; name a folder in it"


def why_no_file(path: Path) -> str:
    """Why there is no file to be read at ``path``; "" if there is one."""
    try:
        size_of(path)
    except OSError as error:
        return error.strerror or str(error)
    return os.strerror(errno.EISDIR) if os.path.isdir(path) else ""


def why_no_folder(path: Path) -> str:
    """Why ``path`` is no folder that can be searched; "" if it is one."""
    if not os.path.isdir(path):
        return "is not a folder" if os.path.exists(path) else "does not exist"
    try:
        entries_below(path)
    except OSError as error:
        return str(error.strerror)
    return ""


def meant(path: Path) -> str:
    """``did you mean models/tank.scxml?``, where nothing is called ``path``; "" if nothing is near.

    Of the first part that does not exist, what is in its folder and named almost so, in another case, or
    so with an ending; backslashes may have been meant to separate folders.
    """
    if os.path.lexists(path):
        return ""
    slashes = Path(str(path).replace("\\", "/"))
    if slashes != path and os.path.exists(slashes):
        return f"did you mean {slashes}?"
    parts = path.parts
    for index, part in enumerate(parts):
        here = Path(*parts[: index + 1])
        if os.path.exists(here):
            continue
        name = _nearest_entry(here.parent, part)
        if name in ("", part):  # itself: a loop of links
            return ""
        found = here.with_name(name)
        whole = found.joinpath(*parts[index + 1 :])
        if os.path.exists(whole):
            return f"did you mean {whole}?"
        return meant(whole) or f"did you mean {found}?"
    return ""


def _nearest_entry(folder: Path, name: str) -> str:
    try:
        with os.scandir(folder) as entries:
            names = sorted(entry.name for entry in itertools.islice(entries, _MOST_COMPARED))
    except OSError:  # none, or not ours to look into
        return ""
    alike = [item for item in names if item.lower() == name.lower()]
    alike += [item for item in names if Path(item).stem == name]
    near = difflib.get_close_matches(name[:_MAX_COMPARED], names)
    stem = Path(name).stem[:_MAX_COMPARED]  # a common ending makes no two names alike
    alike += [item for item in near if difflib.get_close_matches(stem, [Path(item).stem])]
    return alike[0] if alike else ""


def entries_below(folder: Path) -> list[Path]:
    """The files and folders below ``folder``, sorted; links are named, not followed.

    Raises:
        OSError: they are more than ``MAX_ENTRIES``, as in ``/``.
    """
    found: list[Path] = []
    for parent, folders, files in os.walk(folder):
        found += [Path(parent, name) for name in (*folders, *files)]
        if len(found) > MAX_ENTRIES:
            raise OSError(errno.EFBIG, _TOO_LARGE)
    return sorted(found)
