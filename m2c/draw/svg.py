"""SVG: shapes and text as strings, how wide text is, and the paper they are put on.

The same shapes stand in files of their own and inside HTML pages: their colours are classes, for
which :func:`document` brings a style and a page may bring its own.
"""

from __future__ import annotations

import unicodedata
from collections.abc import Iterable
from html import escape
from textwrap import wrap

import msgspec

from m2c.printable import printable

SANS, MONO = 13.0, 11.0
"""Font sizes of names and of code."""
LINE = 14.0
"""From one line of code to the next."""
_MONO_ADVANCE = 0.605
"""Of an em, for a character of code: DejaVu Sans Mono has 0.602, others less."""
_NARROW, _BROAD = "iljtfr.,:;'|!()[]I/ ", "mwMWQOGCDHNUAB@%&—"
"""Characters of less and of more than the usual width (Arial's metrics)."""

STYLE = """\
.box{fill:#fff;stroke:#333;stroke-width:1.4}.tool{fill:#e8eef7;stroke:#1f3f77;stroke-width:1.6}
.outside{fill:#fff;stroke:#777;stroke-width:1.2;stroke-dasharray:5 3}
.rule{stroke:#bbb;stroke-width:1}.frame{fill:none;stroke:#999;stroke-width:1}
.line{stroke:#333;stroke-width:1.4;fill:none}.topic{stroke-dasharray:2 3}.action{stroke-width:3.2}
.ground{fill:none;stroke:none}.dot{fill:#333}.tip{fill:#333}text{fill:#111}.small{font-size:11px;fill:#444}.head{font-weight:bold}
.code{font-family:"DejaVu Sans Mono",Menlo,Consolas,monospace;font-size:11px;white-space:pre}
.event{fill:#123a7a;font-weight:bold}.guard{fill:#7a3e00}.action-text{fill:#444}
"""


class Picture(msgspec.Struct, frozen=True):
    """Shapes on an area of ``width`` by ``height`` units (pixels at scale 1)."""

    width: float
    height: float
    parts: tuple[str, ...]


def document(picture: Picture, title: str) -> str:
    """``picture`` as an SVG file, on white paper."""
    width, height = _round_up(picture.width), _round_up(picture.height)
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" '
        f'viewBox="0 0 {width} {height}" font-family="Helvetica, Arial, sans-serif" '
        f'font-size="{SANS:g}">\n<title>{clean(title)}</title>\n<style>\n{STYLE}</style>\n'
        f'{marker("tip")}\n<rect width="{width}" height="{height}" fill="#fff"/>\n'
    )
    return head + "\n".join(picture.parts) + "\n</svg>\n"


def inline(picture: Picture, title: str, prefix: str) -> str:
    """``picture`` as an element of an HTML page, which styles it; ``prefix`` as when it was drawn."""
    width, height = _round_up(picture.width), _round_up(picture.height)
    head = (
        f'<svg class="drawing" viewBox="0 0 {width} {height}" width="{width}" height="{height}" '
        f'role="img" font-family="Helvetica, Arial, sans-serif" font-size="{SANS:g}">'
        f"<title>{clean(title)}</title>{marker(f'{prefix}tip')}"
    )
    return head + "".join(picture.parts) + "</svg>"


def marker(name: str) -> str:
    """The head of arrows."""
    return (
        f'<defs><marker id="{name}" viewBox="0 0 8 8" refX="7.5" refY="4" markerWidth="8" '
        'markerHeight="8" markerUnits="userSpaceOnUse" orient="auto">'
        '<path class="tip" d="M0,0 L8,4 L0,8 z"/></marker></defs>'
    )


def box(
    x: float, y: float, width: float, height: float, kind: str = "box", corner: float = 4
) -> str:
    """A box with corners of radius ``corner``."""
    size = f'width="{number(width)}" height="{number(height)}"'
    return f'<rect class="{kind}" x="{number(x)}" y="{number(y)}" {size} rx="{number(corner)}"/>'


def text(x: float, y: float, words: str, kind: str = "", anchor: str = "start") -> str:
    """A line of text; ``y`` is its base line."""
    style = f'class="{kind}" ' if kind else ""
    place = f' text-anchor="{anchor}"' if anchor != "start" else ""
    return f'<text {style}x="{number(x)}" y="{number(y)}"{place}>{clean(words)}</text>'


def line(points: str, kind: str = "line", tip: str = "") -> str:
    """A path, with an arrow's head called ``tip`` at its end."""
    head = f' marker-end="url(#{tip})"' if tip else ""
    return f'<path class="{kind}"{head} d="{points}"/>'


def rule(x: float, y: float, end: float) -> str:
    """A thin horizontal line."""
    return f'<path class="rule" d="M{number(x)},{number(y)} H{number(end)}"/>'


def group(parts: Iterable[str], kind: str = "", name: str = "", title: str = "") -> str:
    """Shapes that belong together; ``title`` is shown when one points at them."""
    attributes = (f' class="{kind}"' if kind else "") + (f' id="{name}"' if name else "")
    about = f"<title>{clean(title)}</title>" if title else ""
    return f"<g{attributes}>{about}{''.join(parts)}</g>"


def clean(words: str) -> str:
    """``words`` as an element's content; what XML 1.0 has no character for (2.2) is printable then."""
    return escape(printable(words), quote=False)


def number(value: float) -> str:
    """With one decimal at most: the same bytes on every machine."""
    rounded = f"{value:.1f}"
    return rounded.removesuffix(".0") if rounded != "-0.0" else "0"


def cells(words: str) -> int:
    """How many columns of fixed width ``words`` take."""
    return sum(
        0 if unicodedata.combining(c) else 2 if unicodedata.east_asian_width(c) in "WF" else 1
        for c in words
    )


def code_width(words: str) -> float:
    """Width of a line of code."""
    return cells(words) * MONO * _MONO_ADVANCE


def name_width(words: str, size: float = SANS, bold: bool = True) -> float:
    """Width of a name, rather too wide than too narrow."""
    total = 0.0
    for character in words:
        if unicodedata.east_asian_width(character) in "WF":
            total += 1.05
        elif character in _NARROW:
            total += 0.36
        elif character in _BROAD:
            total += 0.89
        else:
            total += 0.60
    return total * size * (1.04 if bold else 1.0)


def folded(words: str, columns: int) -> list[str]:
    """``words``, printable, in lines of at most ``columns``; further lines are indented.

    ``is_ok: true`` stays together.
    """
    indent = " " * (len(words) - len(words.lstrip(" ")))
    inside = printable(" ".join(words.split())).replace(": ", ":\N{NO-BREAK SPACE}")
    lines = wrap(
        inside,
        columns,
        initial_indent=indent,
        subsequent_indent=indent + "  ",
        break_on_hyphens=False,
    )
    return [one.replace("\N{NO-BREAK SPACE}", " ") for one in lines] or [""]


def shortened(words: str, columns: int) -> str:
    """``words``, printable, with ``…`` for what exceeds ``columns``."""
    shown = printable(words)
    return shown if len(shown) <= columns else shown[: columns - 1] + "…"


def _round_up(value: float) -> int:
    return int(-(-value // 1))
