"""Lines of Python that stay as they are under ``ruff format``: one call on one line, or exploded."""

from __future__ import annotations

from collections.abc import Sequence

WIDTH = 100
"""Columns of generated code."""
INDENT = "    "


def call(head: str, arguments: Sequence[str], depth: int, tail: str = "") -> list[str]:
    """``head(arguments…)tail`` at ``depth``: on one line if it fits, else as ruff would break it."""
    margin = INDENT * depth
    flat = f"{margin}{head}({', '.join(arguments)}){tail}"
    if len(flat) <= WIDTH or not arguments:
        return [flat]
    inner = INDENT * (depth + 1)
    joined = f"{inner}{', '.join(arguments)}"
    if len(joined) <= WIDTH:
        return [f"{margin}{head}(", joined, f"{margin}){tail}"]
    exploded = [f"{inner}{argument}," for argument in arguments]
    return [f"{margin}{head}(", *exploded, f"{margin}){tail}"]


def indent(lines: Sequence[str], depth: int = 1) -> list[str]:
    """``lines``, ``depth`` levels deeper."""
    return [f"{INDENT * depth}{line}" if line else line for line in lines]


def fit(lines: Sequence[str]) -> list[str]:
    """Break the calls and strings that have come to stand too far right."""
    fitted: list[str] = []
    for line in lines:
        fitted += _broken(line)
    return fitted


def _broken(line: str) -> list[str]:
    text = line.lstrip()
    margin = line[: len(line) - len(text)]
    if len(line) <= WIDTH or text.startswith(("#", '"""')):
        return [line]
    head, found, value = text.partition(" = ")
    if found and value.startswith('"'):
        return [f"{margin}{head} = (", f"{margin}{INDENT}{value}", f"{margin})"]
    opening = text.find("(")
    closing = text.rfind(")")
    if opening < 1 or '"' in text[:opening] or _partner(text, opening) != closing:
        return [line]  # not one call: too long, and right
    if not (text[opening - 1].isidentifier() or text[:opening].endswith(" in ")):
        return [line]  # brackets around a part: a comma in them would make a tuple
    inner = text[opening + 1 : closing]
    arguments = _split(inner)
    depth = len(margin) // len(INDENT)
    if text[:opening].endswith(" in "):  # a tuple, not a call: one element a line
        elements = [f"{margin}{INDENT}{element}," for element in arguments]
        return [f"{margin}{text[: opening + 1]}", *elements, f"{margin}{text[closing:]}"]
    broken = call(text[:opening], arguments, depth, text[closing + 1 :])
    if len(broken) == 1:
        return broken
    return [broken[0], *(piece for item in broken[1:-1] for piece in _broken(item)), broken[-1]]


def _partner(text: str, opening: int) -> int:
    """Where the bracket at ``opening`` is closed; -1 if that cannot be told without a parser."""
    depth = 0
    quote = ""
    for index in range(opening, len(text)):
        letter = text[index]
        if letter == "\\":
            return -1
        if quote:
            quote = "" if letter == quote else quote
        elif letter in "\"'":
            quote = letter
        elif letter in "([{":
            depth += 1
        elif letter in ")]}":
            depth -= 1
            if depth == 0:
                return index
    return -1


def _split(text: str) -> list[str]:
    """The top-level arguments in ``text``."""
    arguments: list[str] = []
    depth = 0
    quote = ""
    start = 0
    for index, letter in enumerate(text):
        if quote:
            quote = "" if letter == quote and text[index - 1] != "\\" else quote
        elif letter in "\"'":
            quote = letter
        elif letter in "([{":
            depth += 1
        elif letter in ")]}":
            depth -= 1
        elif letter == "," and depth == 0:
            arguments.append(text[start:index].strip())
            start = index + 1
    last = text[start:].strip()
    return [*arguments, last] if last else arguments
