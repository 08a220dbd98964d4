"""Writing a file at once: all of it, or an error that names it."""

from __future__ import annotations

from pathlib import Path


def write_whole(path: Path, content: str | bytes) -> None:
    """Write ``content`` (a text as UTF-8) to ``path``.

    Raises:
        OSError: it cannot be written; ``filename`` says which. What there is of it is not left behind:
            half a generated file would pass for one that was edited.
    """
    try:
        path.write_bytes(content.encode() if isinstance(content, str) else content)
    except OSError as error:
        if error.filename is None and path.is_file():  # it was opened, and is no device
            path.unlink()
        raise OSError(error.errno, error.strerror, str(path)) from error
