"""XML as plain data: what a generated model, policy or structure is until it is written."""

from __future__ import annotations

from collections.abc import Iterator
from xml.sax.saxutils import escape, quoteattr

import msgspec


class Element(msgspec.Struct, frozen=True):
    """An element: its tag, its attributes in order, its children, or its text."""

    tag: str
    attributes: tuple[tuple[str, str], ...] = ()
    children: tuple[Element, ...] = ()
    text: str = ""

    def get(self, name: str) -> str:
        """The attribute ``name``; "" where it has none."""
        return dict(self.attributes).get(name, "")

    def holding(self, *children: Element) -> Element:
        """The same with these children."""
        return msgspec.structs.replace(self, children=children)

    def all(self) -> Iterator[Element]:
        """It and everything inside it."""
        yield self
        for child in self.children:
            yield from child.all()

    def __str__(self) -> str:
        return "\n".join(self._lines(0))

    def _lines(self, depth: int) -> Iterator[str]:
        indent = "  " * depth
        head = self.tag + "".join(f" {name}={quoteattr(value)}" for name, value in self.attributes)
        if self.text:
            yield f"{indent}<{head}>{escape(self.text)}</{self.tag}>"
        elif not self.children:
            yield f"{indent}<{head}/>"
        else:
            yield f"{indent}<{head}>"
            for child in self.children:
                yield from child._lines(depth + 1)
            yield f"{indent}</{self.tag}>"


def e(tag: str, *children: Element, **attributes: object) -> Element:
    """An element; attributes that are None are left out."""
    given = tuple((name, str(value)) for name, value in attributes.items() if value is not None)
    return Element(tag, given, children)
