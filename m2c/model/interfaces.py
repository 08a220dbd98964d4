"""Interface definitions: ``.msg``, ``.srv``, ``.action`` and ``.idl`` files, and ROS 2's standard messages.

A behaviour tree's ticks need no definitions of the user's: ``bt_interfaces`` is built in.

A file's text is read by :mod:`m2c.model.definitions` or :mod:`m2c.model.idl`. The standard types need no file
(:mod:`m2c.model.standard`).
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import msgspec

from m2c.diagnostics import DiagnosticLog, Position
from m2c.language.datatypes import Structure, describe
from m2c.model.builtin import BUILTIN, PACKAGE
from m2c.model.definitions import LOWER_NAME, PARTS, read_definition
from m2c.model.file_size import size_of
from m2c.model.idl import read_idl
from m2c.model.paths import entries_below
from m2c.model.standard import standard_texts

_TYPE = re.compile(r"[A-Z][A-Za-z0-9]*")
IDL = "idl"
"""The ending of a definition in OMG's IDL, in a folder ``msg``, ``srv`` or ``action``."""
CALLED = {"msg": "a message", "srv": "a service", "action": "an action"}
"""What a type of each kind is."""
MAX_NESTING = 32
"""Messages inside messages; the deepest of ROS 2's standard ones has 6."""
MAX_BYTES = 1024 * 1024
"""The longest standard definition has 14 kB, nearly all of it comments."""


class ServiceType(msgspec.Struct, frozen=True):
    """A service definition such as ``std_srvs/srv/SetBool``."""

    name: str
    request: Structure
    response: Structure


class ActionType(msgspec.Struct, frozen=True):
    """An action definition such as ``example_interfaces/action/Fibonacci``."""

    name: str
    goal: Structure
    result: Structure
    feedback: Structure


def fault_of(error: KeyError) -> tuple[str, str]:
    """What is wrong with a type, and what would be right, as :class:`InterfaceLibrary` raised it."""
    what, *hint = map(str, error.args)
    if hint:
        return what, hint[0]
    what, _, near = what.partition("; did you mean ")
    right = "give the folder of its definition with --interfaces"
    return what, f"did you mean {near} else {right}" if near else right


def canonical(name: str, kind: str) -> str:
    """``pkg/Name``, ``pkg/msg/Name`` or ``pkg::msg::Name`` as ``pkg/<kind>/Name``.

    Args:
        name: a type name in any spelling.
        kind: ``msg``, ``srv`` or ``action``; used where the name does not say it.
    """
    parts = name.strip().replace("::", "/").split("/")
    return f"{parts[0]}/{kind}/{parts[1]}" if len(parts) == 2 else "/".join(parts)


class InterfaceLibrary:
    """The interface types that a set of models can refer to: without any, the built-in ones.

    Attributes:
        structures: the data structures that the system declares (:mod:`m2c.model.structs`), by name.
        lacks_structures: some could not be read, so that a name may be of one of them.
    """

    def __init__(self) -> None:
        self.structures: Mapping[str, Structure] = {}
        self.lacks_structures = False
        self._files: dict[str, Path] = dict(BUILTIN)
        self._others: dict[str, list[Path]] = {}
        """Further files that define a type, which are not used."""
        self._structures: dict[str, Structure] = {}
        self._defined: set[str] = set()
        self._open: list[str] = []
        self._log = DiagnosticLog()

    @classmethod
    def load(cls, directories: Sequence[Path], log: DiagnosticLog) -> InterfaceLibrary:
        """Index the definitions below ``directories`` (``<package>/{msg,srv,action}/*``).

        An ``.idl`` is read where no definition of another kind stands beside it, of which it is made.
        A file is parsed when it is first asked for; faults in it go to ``log`` then. Where several files
        define a type, that of the first directory is used, and ``differing-definition`` names those that
        define it otherwise. A package that is called like a built-in one takes its place, as a whole.
        """
        library = cls()
        library._log = log
        own: dict[str, list[Path]] = {}
        for directory in directories:
            try:
                entries = dict.fromkeys(entries_below(directory))
            except OSError as error:
                what = f"this interface folder {error.strerror}"
                log.error("unreadable-file", Position(str(directory)), "", what)
                continue
            for path in entries:
                if path.parent.name not in PARTS or path.suffix[1:] not in (path.parent.name, IDL):
                    continue
                if path.suffix[1:] == IDL and path.with_suffix(f".{path.parent.name}") in entries:
                    continue  # made of the definition beside it
                kind = path.parent.name
                own.setdefault(f"{path.parent.parent.name}/{kind}/{path.stem}", []).append(path)
        packages = {_package(name) for name in own}
        kept = {name: path for name, path in BUILTIN.items() if _package(name) not in packages}
        library._files = kept | {name: paths[0] for name, paths in own.items()}
        library._others = {name: paths[1:] for name, paths in own.items()}
        return library

    @property
    def folders(self) -> tuple[Path, ...]:
        """The folders of packages in which definitions were found."""
        return tuple(sorted({path.parents[2] for path in self._files.values()}))

    def names(self, kind: str) -> list[str]:
        """The custom types of ``kind`` (``msg``, ``srv``, ``action``), sorted.

        A built-in one is named unless a package of the user's has a type that is called so.
        """
        found = [name for name in self._files if name.split("/")[1] == kind]
        own = {name.rpartition("/")[2] for name in found if not self._is_builtin(name)}
        return sorted(
            name
            for name in found
            if not self._is_builtin(name)
            or (_package(name) == PACKAGE and name.rpartition("/")[2] not in own)
        )

    def structure(self, name: str) -> Structure | None:
        """A message, or part of a service or action (``pkg/srv/Name_Response``); None if not known."""
        try:
            return self._structure(name)
        except KeyError:
            return None

    def define(self, structure: Structure) -> None:
        """Have a message type that no file defines, or another in the place of one that was defined so."""
        self._defined.add(structure.name)
        self._structures[structure.name] = structure

    def defined(self) -> tuple[Structure, ...]:
        """The types that :meth:`define` was given, sorted by name."""
        return tuple(self._structures[name] for name in sorted(self._defined))

    def file(self, name: str) -> Path | None:
        """The file that defines ``name`` (``pkg/<kind>/Name``); None for ROS 2's standard types."""
        return self._files.get(name)

    def _is_builtin(self, name: str) -> bool:
        return name in BUILTIN and self._files[name] == BUILTIN[name]

    def message(self, name: str) -> Structure:
        """The message type ``name``; KeyError with a suggestion if there is none."""
        full = canonical(name, "msg")
        package, _, rest = full.partition("/")
        if rest.count("/") == 1 and not rest.startswith("msg/"):  # e.g. a part of a service
            name = f"{package}/msg/{rest.rpartition('/')[2]}"
            self._refuse_other_kind(full, "msg")
            raise KeyError(f"unknown type {full}; a message type is written like {name}")
        if full not in self._structures and not self._is_known(full):
            self._refuse_other_kind(full, "msg")
        return self._structure(full)

    def service(self, name: str) -> ServiceType:
        """The service type ``name``; KeyError with a suggestion if there is none."""
        full = canonical(name, "srv")
        self._require(full, "srv")
        return ServiceType(full, *(self._structure(f"{full}_{part}") for part in PARTS["srv"]))

    def action(self, name: str) -> ActionType:
        """The action type ``name``; KeyError with a suggestion if there is none."""
        full = canonical(name, "action")
        self._require(full, "action")
        return ActionType(full, *(self._structure(f"{full}_{part}") for part in PARTS["action"]))

    def _require(self, full: str, kind: str) -> None:
        """KeyError if ``full`` is no type of ``kind``: what it is instead, or that it is unknown."""
        if f"/{kind}/" in full and self._is_known(full):
            return
        self._refuse_other_kind(full, kind)
        raise KeyError(self._unknown(full, kind))

    def _refuse_other_kind(self, full: str, kind: str) -> None:
        """KeyError if a type of another kind is called ``full``, or like it but for the kind."""
        package, _, rest = full.partition("/")
        name = rest.rpartition("/")[2]
        others = (f"{package}/{other}/{name}" for other in CALLED if other != kind)
        for other in filter(self._is_known, others):
            what = f"{other} is {CALLED[other.split('/')[1]]}, not {CALLED[kind]}"
            raise KeyError(what, f"the type of {CALLED[kind]} is written pkg/{kind}/Name")

    def _is_known(self, full: str) -> bool:
        return full in self._files or full in standard_texts()

    def _structure(self, full: str) -> Structure:
        known = self._structures.get(full)
        if known is not None:
            return known
        if full.count("/") != 2:
            raise KeyError(f"unknown type {full}; a type is written pkg/Name")
        self._parse_file(full)
        found = self._structures.get(full)
        if found is None:
            raise KeyError(self._unknown(full, "msg"))
        return found

    def _parse_file(self, full: str) -> None:
        kind = full.split("/")[1]
        stem = full.rpartition("_")[0] if len(PARTS.get(kind, ())) > 1 else full
        if stem in self._files:
            file = str(self._files[stem])
            read = _read(self._files[stem], self._log)
            if read is None:
                return
            text = read
        elif stem in standard_texts():
            text, file = standard_texts()[stem], stem
        else:
            return
        if len(self._open) >= MAX_NESTING:
            what = f"types are nested more than {MAX_NESTING} deep"
            self._log.error("bad-interface", Position(file, 1, 1), "", what)
            return
        if stem in self._open:
            self._log.error("recursive-type", Position(file, 1, 1), "", f"{stem} contains itself")
            return
        self._check_type_name(stem, file)
        self._open.append(stem)
        for made in self._defined_by(stem, text, file, self._log):
            self._structures[made.name] = made
        self._open.pop()
        for other in self._others.get(stem, ()):
            self._compare(stem, other, text)

    def _defined_by(
        self, stem: str, text: str, file: str, log: DiagnosticLog
    ) -> tuple[Structure, ...]:
        """What ``text`` defines: the type ``stem``, or all parts of it."""
        if not file.endswith(f".{IDL}"):
            return read_definition(stem, text, file, self.message, log)
        fine = not log.has_errors
        names = [f"{stem}_{part}" if part else stem for part in PARTS[stem.split("/")[1]]]
        found = {made.name: made for made in read_idl(text, file, self.message, log, only=names)}
        missing = [name for name in names if name not in found]
        if missing and fine and not log.has_errors:
            *modules, last = missing[0].split("/")
            what = f"no struct {last} is defined in the module {'::'.join(modules)}"
            log.error("bad-interface", Position(file, 1, 1), "", what)
        return tuple(found.get(name, Structure(name, ())) for name in names)

    def _compare(self, stem: str, other: Path, used: str) -> None:
        """Report that ``other`` does not define the type ``stem`` as the text ``used`` does."""
        log = DiagnosticLog()
        text = _read(other, log)
        if text == used:
            return
        made = self._defined_by(stem, text or "", str(other), log)
        if log.has_errors or any(_said(self._structures[it.name]) != _said(it) for it in made):
            what = f"{stem} is defined differently in {other}"
            hint = "this file is used: its folder comes first"
            self._log.warning(
                "differing-definition", Position(str(self._files[stem])), "", what, hint
            )

    def _check_type_name(self, stem: str, file: str) -> None:
        package, _, name = stem.split("/")
        for text, what, pattern, rule in (
            (package, "package", LOWER_NAME, "lower-case letters, digits and single underscores"),
            (name, "type", _TYPE, "letters and digits, beginning with a capital"),
        ):
            if pattern.fullmatch(text) is None:
                message = f"ROS 2 allows no {what} called `{text}`"
                self._log.error("bad-interface", Position(file), "", message, rule)

    def _unknown(self, full: str, kind: str) -> str:
        standard = [name for name in standard_texts() if name.split("/")[1] == kind]
        near = difflib.get_close_matches(full, [*self.names(kind), *standard], 1)
        return f"unknown type {full}" + (f"; did you mean {near[0]}?" if near else "")


def _read(path: Path, log: DiagnosticLog) -> str | None:
    """The text of the definition in ``path``; None after reporting why there is none."""
    try:
        size_of(path)  # or it cannot be read
        with path.open("rb") as opened:
            content = opened.read(MAX_BYTES + 1)
    except OSError as error:
        what = f"cannot read the file: {error.strerror}"
        log.error("unreadable-file", Position(str(path)), "", what)
        return None
    if len(content) > MAX_BYTES:
        what = f"the definition is larger than {MAX_BYTES} bytes"
        log.error("bad-interface", Position(str(path)), "", what)
        return None
    return content.decode("utf-8", errors="replace")


def _said(made: Structure) -> tuple[object, ...]:
    """What a definition says; IDL has one name for ``char`` and ``uint8``."""
    kinds = [(name, describe(kind).replace("char", "uint8")) for name, kind in made.fields]
    constants = [(name, value) for name, _, value in made.constants]
    return kinds, sorted(made.defaults), constants


def _package(name: str) -> str:
    return name.partition("/")[0]
