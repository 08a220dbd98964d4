"""Text that may stand in a generated file as it is, and how model text becomes such text.

A template prints nothing but :class:`Source` (see ``m2c.codegen.rendering``): what comes from a model is
plain text, which is refused until one of the functions here has made it a literal, a part of a doc string,
or a name. So no model text becomes code, whatever a template does.
"""

from __future__ import annotations

import json
import math
from typing import Any, Self

from markupsafe import Markup

from m2c.model.xml_writing import writable
from m2c.printable import printable

_SHOWN = 60
"""Characters of a text that a message repeats."""


class PlainTextError(TypeError):
    """Plain text stands where only :class:`Source` may."""

    def __init__(self, text: str) -> None:
        shown = text if len(text) <= _SHOWN else f"{text[:_SHOWN]}…"
        super().__init__(
            f"{shown!r} is text of the model, not code: write it with a filter (|py, |doc, |toml, |xml)"
        )


class Source(Markup):
    """Text that was made for a generated file: a literal, a name, an expression, a doc string's words.

    Joined with plain text it refuses it; that is the use of its base class, whose templates know it.
    """

    __slots__ = ()

    @classmethod
    def escape(cls, s: Any, /) -> Self:
        """``s``, which must be a number or was made for a generated file itself.

        Raises:
            PlainTextError: it is plain text.
        """
        if isinstance(s, Markup | int):
            return cls(s)
        raise PlainTextError(str(s))


def name(text: str) -> Source:
    """``text`` as a Python name or a dotted path of names.

    Raises:
        ValueError: it is none; names are made in ``m2c.codegen.names``.
    """
    if not text.isascii() or not all(part.isidentifier() for part in text.split(".")):
        raise ValueError(f"{text!r} is no name in Python")
    return Source(text)


def quoted(text: str) -> str:
    """``text`` as a Python string literal, in the quotes that a formatter prefers."""
    literal = repr(text)
    if literal.startswith("'") and '"' not in literal:
        literal = '"' + literal[1:-1].replace("\\'", "'") + '"'
    return literal


def py(value: object) -> Source:
    """``value`` (text, a number, a truth value, None) as a Python literal.

    Raises:
        TypeError: it is something else.
    """
    if isinstance(value, str):
        return Source(quoted(str(value)))
    if isinstance(value, float) and not math.isfinite(value):
        return Source(f'float("{value}")')
    if value is None or isinstance(value, bool | int | float):
        return Source(repr(value))
    raise TypeError(f"{type(value).__name__} is no literal")


def doc(text: str) -> Source:
    """``text`` within a doc string: on one line, nothing ends the string, nothing is invisible."""
    return Source(printable(str(text)).replace("\\", "\\\\").replace('"', '\\"'))


def toml(text: str) -> Source:
    """``text`` as a basic string of TOML (https://toml.io/en/v1.0.0#string)."""
    return Source(json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f"))


def xml(text: str) -> Source:
    """``text`` as character data or an attribute's value of XML 1.0; what XML forbids becomes U+FFFD."""
    return Source(Markup.escape(writable(str(text))))


FILTERS = {"py": py, "doc": doc, "toml": toml, "xml": xml, "name": name}
"""What templates make of model text."""
