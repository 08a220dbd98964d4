"""What the text of a ``.msg``, ``.srv`` or ``.action`` file defines.

Grammar: https://docs.ros.org/en/jazzy/Concepts/Basic/About-Interfaces.html. What ROS 2's own reader
(``rosidl_adapter.parser``) refuses is an error here, too: it could be run on no ROS 2 system.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Callable, Iterator
from typing import Any

from m2c.diagnostics import DiagnosticLog, Position
from m2c.language.datatypes import (
    FLOATS,
    INTEGER_RANGES,
    Array,
    DataType,
    Primitive,
    Structure,
    describe,
)
from m2c.model.constants import Value, parse_value

PARTS = {"msg": ("",), "srv": ("Request", "Response"), "action": ("Goal", "Result", "Feedback")}
"""What a definition of each kind consists of, in its order."""
_RULE = "---"
_FIELD = re.compile(
    r"(?P<base>[\w/]+)(?P<bound><=\d{1,9})?(?P<array>\[(?:(?:<=)?\d{1,9})?\])?[ \t]+"
    r"(?P<name>[A-Za-z]\w*)(?:[ \t]*=(?P<constant>.*)|(?P<rest>.*))",
    re.ASCII,
)
LOWER_NAME = re.compile(r"[a-z][a-z0-9]*(_[a-z0-9]+)*")
_CONSTANT = re.compile(r"[A-Z][A-Z0-9]*(_[A-Z0-9]+)*")
"""Names as ROS 2 allows them: https://design.ros2.org/articles/legacy_interface_definition.html and
the patterns of ``rosidl_adapter.parser``."""
_STRINGS = ("string", "wstring")
_PRIMITIVES = {*INTEGER_RANGES, *FLOATS, "bool", *_STRINGS}
_ROS_2_NAMES = {
    **dict.fromkeys(("boolean", "Boolean", "Bool", "BOOL"), "bool"),
    **dict.fromkeys(("int", "integer", "Integer", "long", "signed"), "int32"),
    **dict.fromkeys(("unsigned", "uint"), "uint32"),
    **dict.fromkeys(("float", "Float", "single"), "float32"),
    **dict.fromkeys(("double", "Double", "real", "number", "Number"), "float64"),
    **dict.fromkeys(("str", "String", "text"), "string"),
    **{"short": "int16", "ushort": "uint16", "ulong": "uint32", "octet": "byte", "wchar": "uint16"},
    **dict.fromkeys(("time", "Time"), "builtin_interfaces/Time"),
    **dict.fromkeys(("duration", "Duration"), "builtin_interfaces/Duration"),
    **{"header": "std_msgs/Header", "Header": "std_msgs/Header"},
}
"""What other languages, and ROS 1, call a type of ROS 2."""

Find = Callable[[str], Structure]
"""The message type of a name; KeyError with a sentence if there is none."""


def ros_2_name(written: str) -> str:
    """What ROS 2 calls the type that other languages call ``written``, or ROS 1; "" if none is known."""
    return _ROS_2_NAMES.get(written, "")


def read_definition(
    stem: str, text: str, file: str, find: Find, log: DiagnosticLog
) -> tuple[Structure, ...]:
    """The structures that a definition defines: a message, or the parts of a service or an action.

    Args:
        stem: the type's name, ``pkg/<kind>/Name``.
        text: the definition.
        file: where it stands.
        find: gives the message types that it refers to.
        log: where faults go: ``bad-interface`` and ``unknown-type``.
    """
    kind = stem.split("/")[1]
    parts = PARTS[kind]
    sections: list[list[tuple[int, str]]] = [[]]
    for number, line in enumerate(text.splitlines(), 1):
        if kind == "msg" or line.strip() != _RULE:
            sections[-1].append((number, line))
            continue
        sections.append([])
        if line != _RULE:
            what = f"white space stands beside `{_RULE}`, which ROS 2 does not take"
            log.error("bad-interface", Position(file, number, 1), "", what)
    if len(sections) != len(parts):
        divided = f"{len(sections)} sections divided by {_RULE}"
        what = f"no line `{_RULE}` divides it" if len(sections) == 1 else divided
        hint = f"a .{kind} file has {len(parts)}"
        if len(sections) < len(parts):
            names = ", ".join(part.lower() for part in parts)
            hint += f" sections: {names}, with `{_RULE}` between them"
        log.error("bad-interface", Position(file, 1, 1), "", what, hint)
    sections += [[]] * (len(parts) - len(sections))
    return tuple(
        _Section(stem, file, find, log).read(f"{stem}_{part}" if part else stem, lines)
        for part, lines in zip(parts, sections, strict=False)
    )


class _Section:
    """A message, or a part of a service or action."""

    def __init__(self, stem: str, file: str, find: Find, log: DiagnosticLog) -> None:
        self._package = stem.partition("/")[0]
        self._file = file
        self._find = find
        self._log = log
        self._fields: dict[str, DataType] = {}
        self._defaults: list[tuple[str, Any]] = []
        self._constants: dict[str, tuple[str, str, Value]] = {}

    def read(self, name: str, lines: list[tuple[int, str]]) -> Structure:
        """The structure ``name`` that ``lines``, each with its number, define."""
        for line, at in self._written(lines):
            match = _FIELD.fullmatch(line)
            if match is None or _has_no_name(match):
                hint = "a line is `type name`, `type name default` or `type NAME=constant`"
                self._error(at, f"cannot read `{line}`", hint)
            elif match["name"] in self._fields or match["name"] in self._constants:
                self._error(at, f"a second field is called `{match['name']}`")
            else:
                self._member(match, at)
        constants = tuple(self._constants.values())
        return Structure(name, tuple(self._fields.items()), tuple(self._defaults), constants)

    def _written(self, lines: list[tuple[int, str]]) -> Iterator[tuple[str, Position]]:
        for number, raw in lines:
            line = _without_comment(raw).rstrip()
            text = line.lstrip()
            if not text:
                continue
            at = Position(self._file, number, len(line) - len(text) + 1)
            if line != text:
                what = f"white space stands before `{text.split()[0]}`, which ROS 2 does not take"
                self._error(at, what, "begin the line with the type")
            yield text, at

    def _error(self, at: Position, what: str, hint: str = "") -> None:
        self._log.error("bad-interface", at, "", what, hint)

    def _member(self, match: re.Match[str], at: Position) -> None:
        constant, default = match["constant"], (match["rest"] or "").strip()
        self._check_name(match["name"], constant is not None, at)
        kind = self._type(match, at)
        if kind is None:
            return
        if "=" in default:
            what = f"ROS 2 takes `{match['name']} {default}` for a constant: it has a `=`"
            self._error(at, what, "a default value has none")
            return
        written = default if constant is None else constant.strip()
        value = parse_value(written, kind) if written or constant is not None else None
        if constant is not None and (match["bound"] or match["array"]):
            self._error(
                at,
                f"a constant cannot be of type {_as_written(match)}",
                "its type is a primitive without bounds",
            )
        elif value is None and (written or constant is not None):
            self._error(at, f"`{written[:80]}` is not a value of {describe(kind)}")
        elif self._is_too_long(match, value):
            what = f"`{written[:80]}` is longer than {_as_written(match)} allows"
            self._error(at, what)
        elif constant is None:
            self._fields[match["name"]] = kind
            if value is not None:
                self._defaults.append((match["name"], value))
        elif isinstance(value, bool | int | float | str):
            self._constants[match["name"]] = (match["name"], match["base"], value)

    def _check_name(self, name: str, is_constant: bool, at: Position) -> None:
        """A field or a constant; what is wrong is reported with the name that would be right."""
        words = re.sub(r"_+", "_", name).strip("_")
        if is_constant:
            right, pattern, what = words.upper(), _CONSTANT, "constant"
        else:
            right, pattern, what = words.lower(), LOWER_NAME, "field"
        if pattern.fullmatch(name) is None:
            self._error(at, f"ROS 2 allows no {what} called `{name}`", f"write `{right}`")

    def _type(self, match: re.Match[str], at: Position) -> DataType | None:
        element = self._element(match["base"], at)
        if element is None:
            return None
        if match["bound"] and (match["base"] not in _STRINGS or not int(match["bound"][2:])):
            what = f"ROS 2 has no type `{match['base']}{match['bound']}`"
            self._error(at, what, "a string may have a bound, from 1: string<=5")
            return None
        if not match["array"]:
            return element
        size = match["array"][1:-1]
        if not size:
            return Array(element)
        length = int(size.removeprefix("<="))
        if not length:
            what = f"ROS 2 has no array of {'at most ' if '<' in size else ''}0 elements"
            self._error(at, what, "the size of an array is 1 or more; `[]` is any")
            return None
        return Array(element, length, not size.startswith("<="))

    def _element(self, base: str, at: Position) -> DataType | None:
        if base in _PRIMITIVES:
            return Primitive("string" if base == "wstring" else base)
        parts = base.split("/")
        if len(parts) > 2:
            what = f"`{base}` has more than a package and a name, which ROS 2 does not take"
            self._error(at, what, f"write `{parts[0]}/{parts[-1]}`")
            return None
        try:
            return self._find(base if "/" in base else f"{self._package}/msg/{base}")
        except KeyError as error:
            what, hint = str(error.args[0]), ""
            near = difflib.get_close_matches(
                base, sorted(_PRIMITIVES), 1
            )  # types of packages are capitals
            right = ros_2_name(base) or "".join(near)
            if "/" not in base and right:
                what, hint = f"unknown type {base}", f"did you mean {right}?"
            self._log.error("unknown-type", at, "", what, hint)
            return None

    @staticmethod
    def _is_too_long(match: re.Match[str], value: object) -> bool:
        if not match["bound"]:
            return False
        most = int(match["bound"][2:])
        texts = value if isinstance(value, tuple) else (value,)
        return any(isinstance(text, str) and len(text) > most for text in texts)


def _has_no_name(match: re.Match[str]) -> bool:
    """Whether what follows a field's name belongs to it: ``a[]``; ``a;`` is told as a wrong default."""
    return (match["rest"] or " ")[0] not in " \t;"


def _as_written(match: re.Match[str]) -> str:
    return f"{match['base']}{match['bound'] or ''}{match['array'] or ''}"


def _without_comment(line: str) -> str:
    quote = ""
    escaped = False
    for index, character in enumerate(line):
        if escaped:
            escaped = False
        elif quote:
            escaped = character == "\\"
            quote = "" if character == quote else quote
        elif character in "\"'":
            quote = character
        elif character == "#":
            return line[:index]
    return line
