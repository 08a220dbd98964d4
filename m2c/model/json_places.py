"""Reading JSON that may be hostile, keeping the place of every value.

``json`` of the standard library judges whether the text is JSON; where its values stand is found by a walk
over text that is known to be.
"""

from __future__ import annotations

import json
import re
from bisect import bisect_right
from pathlib import Path

import msgspec

from m2c.diagnostics import DiagnosticLog, Position
from m2c.model.file_size import size_of
from m2c.model.paths import meant
from m2c.model.xml_fault import place_of

MAX_BYTES = 1024 * 1024
"""A schema of message types has some kilobytes."""
MAX_DEPTH = 64
"""Objects and arrays inside each other."""
_BLANKS = re.compile(r"[ \t\n\r]*")
_STRING = re.compile(r'"(?:[^"\\]|\\.)*"')
_SCALAR = re.compile(r"[-+.\w]+")


class JsonValue(msgspec.Struct, frozen=True):
    """A value and where it stands; objects and arrays hold values with places of their own."""

    value: dict[str, JsonValue] | list[JsonValue] | str | int | float | bool | None
    position: Position

    def get(self, key: str) -> JsonValue | None:
        """The value of ``key``, if this is an object that has it."""
        return self.value.get(key) if isinstance(self.value, dict) else None

    def text(self, key: str) -> str | None:
        """The text at ``key``, if there is one."""
        found = self.get(key)
        return found.value if found is not None and isinstance(found.value, str) else None


def read_json(path: Path, log: DiagnosticLog) -> JsonValue | None:
    """Parse the file at ``path``; report ``unreadable-file`` or ``malformed-json`` and return None."""
    file = str(path)
    try:
        size = size_of(path)
        content = path.read_bytes() if size <= MAX_BYTES else b""
    except OSError as error:
        what = f"cannot read the file: {error.strerror}"
        log.error("unreadable-file", Position(file), "", what, meant(path))
        return None
    if size > MAX_BYTES:
        what = f"the file has {size} bytes"
        log.error("malformed-json", Position(file), "", what, f"at most {MAX_BYTES} are read")
        return None
    try:
        text = content.decode("utf-8-sig")
        json.loads(text, parse_constant=_refuse)
        return _Walk(text, file).value()
    except UnicodeDecodeError as error:
        before = content[: error.start].decode("utf-8-sig")
        line, column = place_of(before, len(before))
        log.error("malformed-json", Position(file, line, column), "", "malformed JSON: not UTF-8")
    except json.JSONDecodeError as error:
        at = Position(file, error.lineno, error.colno)
        log.error("malformed-json", at, "", f"malformed JSON: {error.msg}")
    except (RecursionError, _TooDeep):
        what = f"malformed JSON: nested more than {MAX_DEPTH} deep"
        log.error("malformed-json", Position(file, 1, 1), "", what)
    except ValueError as error:  # a number of thousands of digits, or NaN
        log.error("malformed-json", Position(file, 1, 1), "", f"malformed JSON: {error}")
    return None


class _TooDeep(Exception):
    pass


def _refuse(constant: str) -> None:
    raise ValueError(f"{constant} is not part of JSON")


class _Walk:
    """The places of the values of ``text``, which is JSON."""

    def __init__(self, text: str, file: str) -> None:
        self._text = text
        self._file = file
        self._offset = 0
        self._lines = [0, *(found.end() for found in re.finditer("\n", text))]

    def value(self, depth: int = 0) -> JsonValue:
        if depth > MAX_DEPTH:
            raise _TooDeep
        self._skip()
        line = bisect_right(self._lines, self._offset)
        at = Position(self._file, line, self._offset - self._lines[line - 1] + 1)
        match self._text[self._offset]:
            case "{":
                return JsonValue(self._object(depth), at)
            case "[":
                return JsonValue(self._array(depth), at)
            case '"':
                return JsonValue(self._string(), at)
        scalar = _SCALAR.match(self._text, self._offset)
        assert scalar is not None
        self._offset = scalar.end()
        return JsonValue(json.loads(scalar[0]), at)

    def _object(self, depth: int) -> dict[str, JsonValue]:
        found: dict[str, JsonValue] = {}
        while self._more("}"):
            key = self._string()
            self._skip()
            self._offset += 1  # the colon
            found[key] = self.value(depth + 1)
        return found

    def _array(self, depth: int) -> list[JsonValue]:
        found: list[JsonValue] = []
        while self._more("]"):
            found.append(self.value(depth + 1))
        return found

    def _more(self, end: str) -> bool:
        """Go past a bracket or comma to the next item; False, past ``end``, if there is none."""
        self._skip()
        if self._text[self._offset] != end:
            self._offset += 1
            self._skip()
        if self._text[self._offset] != end:
            return True
        self._offset += 1
        return False

    def _string(self) -> str:
        found = _STRING.match(self._text, self._offset)
        assert found is not None
        self._offset = found.end()
        return str(json.loads(found[0]))

    def _skip(self) -> None:
        blanks = _BLANKS.match(self._text, self._offset)
        assert blanks is not None
        self._offset = blanks.end()
