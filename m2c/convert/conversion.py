"""Converting what was read, and reading it back before anything is written."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import msgspec

from m2c.convert.comparison import first_difference
from m2c.convert.model import converted_model
from m2c.convert.system_file import converted_system_file
from m2c.convert.trees import elements
from m2c.diagnostics import DiagnosticLog, Position, Severity
from m2c.model.loading import load
from m2c.model.machine import Dialect
from m2c.model.system import System, interfaces_near, is_model
from m2c.model.xml import Element, parse_xml, tree_with_comments
from m2c.output_file import write_whole

SUFFIXES = {Dialect.ASCXML: ".ascxml", Dialect.HL_SCXML: ".scxml"}


class ExistingFilesError(Exception):
    """Files are there already, with other contents."""

    def __init__(self, paths: Sequence[Path]) -> None:
        self.paths = tuple(paths)
        self.lines = (
            f"{'this file exists' if len(paths) == 1 else 'these files exist'}; nothing was written:",
            *(f"  {path}" for path in paths),
            "name another folder, or use --force to overwrite",
        )
        super().__init__("\n".join(self.lines))


class Converted(msgspec.Struct, frozen=True):
    """What was converted.

    Attributes:
        models: how many.
        system: where the system file is in the output; None if models were given.
        written, unchanged: how many files.
    """

    models: int
    system: Path | None
    written: int
    unchanged: int


def convert_files(
    paths: Sequence[Path],
    interfaces: Sequence[Path],
    output: Path,
    dialect: Dialect,
    log: DiagnosticLog,
    *,
    force: bool = False,
) -> Converted | None:
    """Write the models in ``paths``, and the system file that names them, in ``dialect``.

    Args:
        paths: models, folders of them, or one system file.
        interfaces: folders of interface packages.
        output: the folder; what stands in one folder stays together below it.
        dialect: ASCXML or HL-SCXML.
        log: what is wrong with the models, or cannot be said in ``dialect``.
        force: overwrite files that exist.

    Returns:
        What was written; None, and nothing is, if ``log`` has errors.

    Raises:
        ExistingFilesError: files would be overwritten and ``force`` is off; nothing is written.
        OSError: a file cannot be read or written.
    """
    system = load(paths, log, interfaces)
    if system is None or log.has_errors:
        return None
    conversion = _Conversion(system, output.resolve(), dialect, log)
    folders = [*interfaces, *interfaces_near(conversion.models)]
    files = conversion.files(folders)
    if log.has_errors or not conversion.reads_back(files, folders):
        return None
    written, unchanged = _write(files, force)
    system_file = conversion.system_file
    placed = None
    if system_file is not None:
        placed = conversion.targets[system_file].relative_to(output.resolve())
    return Converted(len(conversion.models), placed, written, unchanged)


class _Conversion:
    def __init__(self, system: System, output: Path, dialect: Dialect, log: DiagnosticLog) -> None:
        self._system = system
        self._output = output
        self._dialect = dialect
        self._log = log
        machines = (*system.nodes, *system.plugins)
        is_system = system.path.is_file() and not is_model(system.path)
        self.system_file = system.path.resolve() if is_system else None
        self._machines = {
            path: item
            for item in machines
            if (path := Path(item.position.file).resolve()) != self.system_file  # a bound leaf
        }
        self.models = list(self._machines)
        self.targets = self._placed()

    def _placed(self) -> dict[Path, Path]:
        """Where each file goes; two that go to one place are an error."""
        sources = [*self.models, *([self.system_file] if self.system_file else [])]
        base = os.path.commonpath([path.parent for path in sources]) if sources else ""
        placed: dict[Path, Path] = {}
        for path in sources:
            target = self._output / path.relative_to(base)
            if path != self.system_file:
                target = target.with_suffix(SUFFIXES[self._dialect])
            other = next((known for known, place in placed.items() if place == target), None)
            if other is not None:
                what = f"{other} and this model would both be {target.name}"
                hint = "convert them into two folders, or rename one"
                self._log.error("unfaithful-conversion", Position(str(path)), "", what, hint)
            placed[path] = target
        return placed

    def files(self, folders: Sequence[Path]) -> dict[Path, str]:
        """The texts, by the path where they go."""
        made = {}
        for path, machine in self._machines.items():
            content = path.read_bytes()
            read = _read(content, machine.position.file)
            tree = tree_with_comments(content)
            places = {
                node: element.position
                for node, element in zip(elements(tree), _walk(read), strict=True)
            }
            text = converted_model(tree, places, machine, self._dialect, self._log)
            made[self.targets[path]] = text
        if self.system_file is not None:
            content = self.system_file.read_bytes()
            read = _read(content, str(self._system.path))
            tree = tree_with_comments(content)
            target = self.targets[self.system_file]
            near = [folder.resolve() for folder in folders]
            text = converted_system_file(tree, read, self.system_file, target, self.targets, near)
            made[target] = text
        return made

    def reads_back(self, files: Mapping[Path, str], folders: Sequence[Path]) -> bool:
        """Whether ``files`` are read as what was converted; what differs is an error.

        They are read from a folder beside the one where they go, so that relative paths hold.
        """
        self._output.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".m2c-", dir=self._output.parent) as folder:
            staged = {path: Path(folder, path.relative_to(self._output)) for path in files}
            for path, text in files.items():
                staged[path].parent.mkdir(parents=True, exist_ok=True)
                write_whole(staged[path], text)
            first = [self.system_file] if self.system_file else self.models
            log = DiagnosticLog()
            again = load([staged[self.targets[path]] for path in first], log, folders)
            origins = {str(staged[target]): path for path, target in self.targets.items()}
            refused = next((i for i in log.diagnostics if i.severity is Severity.ERROR), None)
            if refused is None:
                whole = Position(str(self._system.path))
                place = first_difference(self._system, again, whole)
                why = ""
            else:
                origin = origins.get(refused.position.file, self._system.path)
                machine = self._machines.get(origin)
                place = machine.position if machine is not None else Position(str(origin))
                why = f": {refused.message}"
        if place is not None:
            what = f"this would not mean the same in {self._dialect}{why}"
            self._log.error("unfaithful-conversion", place, "", what, "leave it in its dialect")
        return place is None


def _read(content: bytes, file: str) -> Element:
    read = parse_xml(content, file, DiagnosticLog())
    assert read is not None  # it was read before
    return read


def _walk(element: Element) -> Iterable[Element]:
    yield element
    for child in element.children:
        yield from _walk(child)


def _write(files: Mapping[Path, str], force: bool) -> tuple[int, int]:
    """Write what is not there yet; how many files were written, and how many were unchanged."""
    stale = {path: text for path, text in files.items() if not _holds(path, text)}
    present = [path for path in stale if path.exists()]
    if present and not force:
        raise ExistingFilesError(present)
    for path, text in stale.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, text)
    return len(stale), len(files) - len(stale)


def _holds(path: Path, text: str) -> bool:
    return path.is_file() and path.read_bytes() == text.encode()
