"""Expressions at random: values of a wanted type, conditions, and what fails when it is evaluated."""

from __future__ import annotations

from random import Random
from zlib import crc32

import msgspec

from tests.campaign.kinds import (
    BOOL,
    FLOAT64,
    INT32,
    STRING,
    Kind,
)

Readable = tuple[tuple[str, Kind], ...]
"""What an expression may read: how it is written, and its type."""


def parts_of(path: str, kind: Kind, depth: int = 2) -> Readable:
    """What can be read of a value: itself, its fields, the lengths of its arrays."""
    found: list[tuple[str, Kind]] = [(path, kind)] if kind.name else []
    if kind.item is not None:
        found.append((f"{path}.length", INT32))
    if depth:
        for name, inner in kind.fields:
            found += parts_of(f"{path}.{name}", inner, depth - 1)
    return tuple(found)


class Values(msgspec.Struct, frozen=True):
    """Draws expressions.

    Attributes:
        readable: what they may read.
        draws: whether they may draw random values.
    """

    draw: Random
    readable: Readable
    draws: bool = False

    def also(self, more: Readable) -> Values:
        """The same, with more to be read (twice as likely as it is)."""
        return msgspec.structs.replace(self, readable=(*self.readable, *more, *more))

    def of(self, kind: Kind) -> str:
        """A value for a place of the type ``kind``."""
        if kind.is_integer:
            return self.integer()
        if kind.is_float:
            return self.real()
        if kind.name == "bool":
            return self.condition()
        if kind.name == "string":
            return self.text()
        known = [path for path, has in self.readable if has == kind]
        if known and self.draw.random() < 0.5:
            return self.draw.choice(known)
        if kind.item is not None:
            count = self.draw.randint(0, min(kind.bound or 3, 3))
            items = [self.of(kind.item) for _ in range(count)]
            if (
                items and crc32(items[0].encode()) % 3 == 0
            ):  # nothing is drawn: seeds stay what they are
                return f"Array.from({{length: {count}}}, (_, i) => {_as_body(items[0])})"
            return f"[{', '.join(items)}]"
        return f"{{{', '.join(f'{name}: {self.of(inner)}' for name, inner in kind.fields)}}}"

    def _read(self, *wanted: Kind) -> list[str]:
        return [path for path, kind in self.readable if kind in wanted]

    def _integers(self) -> list[str]:
        return [path for path, kind in self.readable if kind.is_integer]

    def _simple(self) -> str:
        found = self._integers()
        if found and self.draw.random() < 0.75:
            return self.draw.choice(found)
        return str(self.draw.randint(0, 5))

    def integer(self) -> str:
        """A small whole number."""
        one = self._simple()
        match self.draw.randint(0, 10):
            case 0:
                return f"({one} + {self._simple()}) % {self.draw.randint(2, 9)}"
            case 1:
                return f"({one} + 1) % {self.draw.randint(3, 9)}"
            case 2:
                return f"({one} * {self._simple()} {'+' if one.isdecimal() else '-'} 1) % 5"
            case 3:
                return f"{self.condition()} ? {one} : {self._simple()}"
            case 4:
                return f"Math.trunc(Math.max(-8, Math.min(8, {one})))"
            case 5 if self._read(FLOAT64):
                return f"Math.floor(Math.abs({self.draw.choice(self._read(FLOAT64))}) % 6)"
            case 6 if self.draws:
                return f"Math.floor(Math.random() * {self.draw.randint(2, 3)})"
            case 7 if self._read(STRING):
                return f"{self.draw.choice(self._read(STRING))}.length"
            case 8 if not one.isdecimal():
                return f"-{one}"
            case _:
                return one

    def real(self) -> str:
        """A fraction."""
        match self.draw.randint(0, 5):
            case 0:
                return f"{self._simple()} / 4"
            case 1:
                return f"Math.sqrt(Math.abs({self._simple()}))"
            case 2:
                return f"{self.draw.randint(0, 40) / 8}"
            case 3:
                return self.draw.choice(("Math.PI", "Math.E * 2", "1 / 0", "0 / 0", "-0.0"))
            case _ if known := self._read(FLOAT64):
                path = self.draw.choice(known)
                return f"{path} > 20 ? 0.5 : {path} + 0.25"
            case _:
                return self._simple()

    def text(self) -> str:
        """A short text."""
        known = self._read(STRING)
        match self.draw.randint(0, 3):
            case 0 if known:
                path = self.draw.choice(known)
                return f"{path}.length > 6 ? '' : {path} + {self._simple()}"
            case 1:
                return f"'n' + {self._simple()}"
            case 2 if known:
                return self.draw.choice(known)
            case _:
                return self.draw.choice(("'on'", "'off'", "'a<b & c'", "'ü'", "''"))

    def condition(self) -> str:
        """What is true or false."""
        flags = self._read(BOOL)
        one, other = self._simple(), self._simple()
        operator = self.draw.choice(("<", "<=", ">", ">=", "==", "!=", "===", "!=="))
        match self.draw.randint(0, 9):
            case 0 | 1 if flags:
                return self.draw.choice(("", "!")) + self.draw.choice(flags)
            case 2:
                return f"{one} {operator} {other}"
            case 3 if flags:
                return f"{self.draw.choice(flags)} || {one} {operator} {other}"
            case 4 if flags:
                return f"{self.draw.choice(flags)} && {one} {operator} {other}"
            case 5 if self.draws:
                return "Math.random() < 0.5"
            case 6 if self._read(STRING):
                return f"{self.draw.choice(self._read(STRING))} == 'on'"
            case 7:
                return f"typeof {one} == 'number'"
            case 8:
                return f"!({one} % 2 == 0)"
            case _:
                return f"{one} {operator} {self.draw.randint(0, 4)}"


def _as_body(item: str) -> str:
    """``item`` as what a function gives: in brackets, an object is no block."""
    return f"({item})" if item.startswith("{") else item


def failing(draw: Random) -> str:
    """What cannot be evaluated, always or sometimes: ``records`` have a ``count``, and are three at most."""
    place = draw.choice(("9", "3", "1", "0", "numbers.length", "numbers[0]"))
    return f"records[{place}].count"
