"""Types of a recording's messages: from the definitions that it carries, or else from elsewhere.

rosbag2 stores with a topic what its type's definition was (``ros2msg`` or ``ros2idl``: the text, then
that of every type in it, each behind a line of ``=`` and one such as ``MSG: pkg/Name``). For service
events some versions store the service's definition (``SRV: …``), some none; old files store nothing.
What is missing, or cannot be read, is looked for in the models' interfaces and ROS 2's standard messages;
what rosidl derives (events of services, the parts of actions) is derived here.
"""

from __future__ import annotations

import re
from typing import Any

from m2c.diagnostics import DiagnosticLog
from m2c.language.datatypes import Array, DataType, Primitive, Structure
from m2c.model.idl import read_idl
from m2c.model.interfaces import MAX_NESTING, InterfaceLibrary

MAX_TEXT = 1024 * 1024
"""A definition with all that it needs; the longest standard one has 40 kB."""
MAX_ALL = 4 * 1024 * 1024
"""All definitions of a recording, each type's counted once: parsing takes 4 µs a character."""
_IDL_COSTS = 30
"""So many times counts a character of IDL: its reader keeps each word, with its place."""
MAX_SECTION = 1024 * 1024
"""The definition of one type, counted in the same way; the longest standard ones have 10 kB."""
MAX_FIELDS = 10_000
"""Of a type, with those of its parts; the largest standard one has some 200. Each level of a definition may
have the next one twice, so that without a limit some lines are a type of 2**30 fields."""

_UNSAID = ("", "unknown")
_IDL = re.compile(r"^\s*module\s+\w+", re.MULTILINE)
_RULE = re.compile(r"^---[ \t]*$", re.MULTILINE)
_DIVIDER = re.compile(r"^={20,}[ \t]*$", re.MULTILINE)
_HEADER = re.compile(r"\s*(MSG|IDL|SRV|ACTION): ([\w/]+)[ \t]*\n?")
_PARTS = {"SRV": ("_Request", "_Response"), "ACTION": ("_Goal", "_Result", "_Feedback")}
_BOUND = re.compile(r"^([ \t]*wstring)<=\d+", re.MULTILINE | re.ASCII)
_WSTRING = "wstring"
_NAME = re.compile(r"[A-Za-z]\w*(?:/\w+)*/[A-Za-z]\w*")

_Key = tuple[str, str]
"""(package, last part of the name): definitions are referred to with and without ``msg``."""


class UnknownTypeError(LookupError):
    """No definition of a type is known, or it cannot be read; the text says which and why."""


class Definitions:
    """The types of one recording.

    Args:
        library: where types are looked for that the recording does not define.
    """

    def __init__(self, library: InterfaceLibrary | None = None) -> None:
        self._library = library or InterfaceLibrary()
        self._fields: dict[_Key, list[tuple[str, Any]]] = {}
        self._faults: dict[_Key, str] = {}
        self._made: dict[str, Structure] = {}
        self._counts: dict[str, int] = {}
        """How many fields each of them has, with those of its parts."""
        self._read: set[tuple[str, str]] = set()
        """Kinds and names of the definitions that were parsed."""
        self._parsed = 0
        """What parsing has cost until now, in characters."""
        self._open: list[str] = []

    def add(self, type_name: str, encoding: str, text: str) -> None:
        """Take in the definition stored with a topic; one that cannot be read is remembered.

        Args:
            type_name: of the topic's messages.
            encoding: ``ros2msg``, ``ros2idl``; ``unknown`` where the recorder does not say (it writes the
                whole text of a service so); others say nothing.
            text: the definition.
        """
        if encoding not in ("ros2msg", "ros2idl", "omgidl", *_UNSAID) or not text.strip():
            return
        text = text.removeprefix("\ufeff").replace("\r\n", "\n").replace("\r", "\n")
        if len(text) > MAX_TEXT:
            self._faults[_key(type_name)] = f"its definition has more than {MAX_TEXT} characters"
            return
        kind = "MSG" if encoding == "ros2msg" else "IDL"
        if encoding in _UNSAID:
            kind = "IDL" if _IDL.search(text) else "MSG"
        for number, section in enumerate(_DIVIDER.split(text)):
            header = _HEADER.match(section)
            if header is not None:
                self._section(header[1], header[2], section[header.end() :])
            elif (number == 0 and section.strip(" \n\r\t=")) or (
                number == 0 and not _DIVIDER.search(text)
            ):
                self._section(*_whole(kind, type_name, section), section)

    def _section(self, kind: str, name: str, text: str) -> None:
        if not _NAME.fullmatch(name) or (kind, name) in self._read:
            return  # each topic brings the definitions of its parts once more
        if kind != "IDL":
            text = _without_blanks(text)
        cost = len(text) * (_IDL_COSTS if kind == "IDL" else 1)
        if cost > MAX_SECTION:
            self._faults[_key(name)] = f"its definition is too long ({len(text)} characters)"
            return
        self._parsed += cost
        if self._parsed > MAX_ALL:
            self._faults[_key(name)] = "the definitions of the recording are too long in all"
            return
        if kind == "IDL":
            self._read_idl(name, text)
        else:
            self._read_lines(kind, name, text)

    def _read_idl(self, name: str, text: str) -> None:
        """Take in the structures of ``text``; what they refer to is looked for when it is needed."""
        log = DiagnosticLog()
        found = read_idl(text, name, lambda other: Structure(other, ()), log, wide=_WSTRING)
        for made in found:
            self._fields.setdefault(_key(made.name), list(made.fields))
        if log.has_errors:
            fault = log.diagnostics[0]
            at = f"line {fault.position.line}, column {fault.position.column}"
            self._faults[_key(name)] = f"its definition cannot be read: {at}: {fault.message}"
        else:
            self._read.add(("IDL", name))

    def _read_lines(self, kind: str, name: str, text: str) -> None:
        from rosbags.typesys import TypesysError, get_types_from_msg

        parts = _PARTS.get(kind, ("",))
        pieces = _RULE.split(text) if kind != "MSG" else [text]
        pieces += [""] * (len(parts) - len(pieces))
        package, last = _key(name)
        try:
            for part, piece in zip(parts, pieces, strict=False):
                found = get_types_from_msg(_BOUND.sub(r"\1", piece), f"{package}/msg/{last}{part}")
                self._fields.setdefault((package, last + part), next(iter(found.values()))[1])
            self._read.add((kind, name))
        except (TypesysError, RecursionError, ValueError, KeyError, AssertionError) as error:
            where = " ".join(str(error).split())
            self._faults[_key(name)] = f"its definition cannot be read: {where[:120]}"

    def structure(self, type_name: str) -> Structure:
        """The type ``type_name``: ``pkg/msg/Name``, ``pkg/srv/Name_Event`` and so on.

        Raises:
            UnknownTypeError: nothing defines it, or what does cannot be read.
        """
        known = self._made.get(type_name)
        if known is not None:
            return known
        if type_name in self._open or len(self._open) > MAX_NESTING:
            raise UnknownTypeError(f"{type_name} contains itself, or is nested too deep")
        self._open.append(type_name)
        try:
            made = self._make(type_name)
        finally:
            self._open.pop()
        count = sum(self._count(kind) for _, kind in made.fields)
        if count > MAX_FIELDS:
            raise UnknownTypeError(
                f"{type_name} has more than {MAX_FIELDS} fields, with its parts'"
            )
        self._made[type_name], self._counts[type_name] = made, count
        return made

    def _count(self, kind: DataType) -> int:
        while isinstance(kind, Array):
            kind = kind.element
        if not isinstance(kind, Structure):
            return 1
        count = self._counts.get(kind.name)
        if count is None:  # from elsewhere, with all its parts
            count = self._counts[kind.name] = sum(self._count(part) for _, part in kind.fields)
        return count + 1

    def _make(self, type_name: str) -> Structure:
        try:
            return self._defined(type_name)
        except UnknownTypeError as incomplete:
            try:
                return self._from_library(type_name)
            except UnknownTypeError:
                fault = self._fault_of(type_name)
                if fault:
                    raise UnknownTypeError(f"{type_name}: {fault}") from None
                raise incomplete from None

    def _defined(self, type_name: str) -> Structure:
        fields = self._fields.get(_key(type_name))
        if fields is None:
            return self._derived(type_name) or self._from_library(type_name)
        package = type_name.partition("/")[0]
        return Structure(
            type_name,
            tuple(
                (name, self._type(kind, package))
                for name, kind in fields
                if name != "structure_needs_at_least_one_member"
            ),
        )

    def _fault_of(self, type_name: str) -> str:
        """Why the definition of ``type_name``, or of what it is a part of, cannot be read; "" if it can."""
        whole = _without_part(type_name) if "/msg/" not in type_name else type_name
        names = (type_name, type_name.rpartition("_")[0], whole)
        return next((self._faults[_key(it)] for it in names if _key(it) in self._faults), "")

    def _type(self, kind: Any, package: str) -> DataType:
        if isinstance(kind, Primitive):
            return kind
        if isinstance(kind, Structure):
            return self.structure(kind.name)
        if isinstance(kind, Array):
            return Array(self._type(kind.element, package), kind.length, kind.fixed)
        node, argument = kind
        match node.name:
            case "BASE":
                return Primitive("byte" if argument[0] == "octet" else argument[0])
            case "NAME" if argument.rpartition("/")[2] == _WSTRING:
                return Primitive(_WSTRING)
            case "NAME":
                return self.structure(argument if "/" in argument else f"{package}/msg/{argument}")
            case "ARRAY":
                return Array(self._type(argument[0], package), argument[1], True)
            case _:
                return Array(self._type(argument[0], package), argument[1] or None)

    def _derived(self, full: str) -> Structure | None:
        """What rosidl derives from services and actions (design.ros2.org, "Actions")."""

        def made(*fields: tuple[str, DataType]) -> Structure:
            return Structure(full, fields)

        def of(name: str) -> Structure:
            return self.structure(name)

        if full == "action_msgs/srv/CancelGoal_Request":
            return made(("goal_info", of("action_msgs/msg/GoalInfo")))
        if full == "action_msgs/srv/CancelGoal_Response":
            goals = Array(of("action_msgs/msg/GoalInfo"))
            return made(("return_code", Primitive("int8")), ("goals_canceling", goals))
        base, _, part = full.rpartition("_")
        if part == "Event" and "/msg/" not in full:
            return made(
                ("info", of("service_msgs/msg/ServiceEventInfo")),
                ("request", Array(of(f"{base}_Request"), 1)),
                ("response", Array(of(f"{base}_Response"), 1)),
            )
        if "/action/" not in full:
            return None
        uuid = "unique_identifier_msgs/msg/UUID"
        action, _, service = base.rpartition("_")
        match service, part:
            case "SendGoal", "Request":
                return made(("goal_id", of(uuid)), ("goal", of(f"{action}_Goal")))
            case "SendGoal", "Response":
                stamp = of("builtin_interfaces/msg/Time")
                return made(("accepted", Primitive("bool")), ("stamp", stamp))
            case "GetResult", "Request":
                return made(("goal_id", of(uuid)))
            case "GetResult", "Response":
                return made(("status", Primitive("int8")), ("result", of(f"{action}_Result")))
            case _, "FeedbackMessage":
                return made(("goal_id", of(uuid)), ("feedback", of(f"{base}_Feedback")))
        return None

    def _from_library(self, full: str) -> Structure:
        base, _, part = full.rpartition("_")
        try:
            if "/srv/" in full and part in ("Request", "Response"):
                service = self._library.service(base)
                return service.request if part == "Request" else service.response
            if "/action/" in full and part in ("Goal", "Result", "Feedback"):
                action = self._library.action(base)
                found: Structure = getattr(action, part.lower())
                return found
            return self._library.message(full)
        except KeyError as error:
            raise UnknownTypeError(
                f"{full}: the recording does not define it, nor do the models' interfaces"
            ) from error


def _whole(kind: str, name: str, text: str) -> tuple[str, str]:
    """Kind and name of what ``text`` defines: of a service's events, all of the service may be stored."""
    base, _, part = name.rpartition("_")
    count = len(_RULE.findall(text))
    if kind == "MSG" and count == 2 and "/action/" in name:
        return "ACTION", _without_part(name)
    if kind != "MSG" or not count or part not in ("Event", "Request", "Response"):
        return ("SRV", name) if kind == "MSG" and count == 1 else (kind, name)
    return "SRV", base


def _without_part(name: str) -> str:
    """What ``name`` is a part of: ``my_pkg/action/Go`` of ``my_pkg/action/Go_SendGoal_Event``."""
    package, slash, last = name.rpartition("/")
    return f"{package}{slash}{last.partition('_')[0]}"


def _without_blanks(text: str) -> str:
    """``text`` without blank lines and comments: the parser takes time with the square of how many follow."""
    lines = (line for line in text.split("\n") if not line.lstrip().startswith("#"))
    return "\n".join(line for line in lines if line.strip()) + "\n"


def _key(name: str) -> _Key:
    package, _, rest = name.partition("/")
    return package, rest.rpartition("/")[2]
