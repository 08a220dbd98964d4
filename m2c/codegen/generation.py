"""Generating a system into a folder: its files, made and written."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import msgspec

from m2c.codegen.package import system_files
from m2c.codegen.packaging import MARKS, packaging_of
from m2c.codegen.rendering import Templates
from m2c.codegen.writer import write_files
from m2c.model.naming import Naming
from m2c.model.system import System


class OtherPackagesError(Exception):
    """A folder has packages for another transport; ``path`` is a file by which that is known."""

    def __init__(self, path: Path, folder: Path, transport: str) -> None:
        self.path = path
        super().__init__(
            f"{path}: {folder} has packages for another transport; "
            f"give those for {transport} a folder of their own"
        )


class Generated(msgspec.Struct, frozen=True):
    """What was generated.

    Attributes:
        paths: of all files, sorted.
        written: how many of them were written.
        unchanged: how many were there already, with the same contents.
        unused: the templates of the given folder from which no file is made.
        templates: the names that a template may have.
    """

    paths: tuple[Path, ...]
    written: int
    unchanged: int
    unused: tuple[Path, ...]
    templates: tuple[str, ...]


def write_system(
    system: System,
    folder: Path,
    transport: str,
    templates: Path | None,
    naming: Naming,
    force: bool = False,
) -> Generated:
    """Generate ``system`` into ``folder``.

    Args:
        system: what is generated, without errors.
        folder: made if it does not exist.
        transport: the middleware of the nodes.
        templates: a folder of templates that override or extend ours.
        naming: the transports that must take the channels that the policy names.
        force: overwrite files that a person has edited.

    Raises:
        ModelError: the policy cannot be used.
        TemplateFault: a template cannot be used.
        EditedFilesError: a file was edited by hand and ``force`` is off; nothing is written.
        OtherPackagesError: there are packages for another transport; nothing is written.
        OSError: a file cannot be read or written.
    """
    packaging = packaging_of(transport)
    made_from = Templates(templates)
    files = system_files(system, packaging, made_from, naming)
    other = _packed_otherwise(files, folder, MARKS[packaging], MARKS.values())
    if other is not None:
        raise OtherPackagesError(other, folder, transport)
    written, unchanged = write_files(files, folder, force)
    return Generated(
        tuple(folder / name for name in sorted(files)),
        written,
        unchanged,
        tuple(made_from.unused()),
        tuple(made_from.names),
    )


def _packed_otherwise(
    files: Iterable[str], output: Path, own: str, marks: Iterable[str]
) -> Path | None:
    """A file in ``output`` that one of the packages of ``files`` has only for another transport."""
    others = [mark for mark in marks if mark != own]
    for name in files:
        if name.endswith(f"/{own}"):
            for other in others:
                path = (output / name).with_name(other)
                if path.exists():
                    return path
    return None
