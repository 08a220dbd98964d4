"""Reading formulas in the syntax that MOON's and Reelay's users write.

``historically``/``H``, ``once``/``P``/``O``, ``since``/``S``, each with ``[a:b]``, ``[a:]`` or ``[:b]``;
``rises``, ``falls``; ``not``/``!``, ``and``/``&&``, ``or``/``||``, ``->``/``implies``, ``true``,
``false``; predicates in braces:
``{p}``, ``{x > 3}``, ``{mode: "Sport", speed < 20}`` (a comma is ``and``, a colon ``==``), any
expression of the models' language. Unary operators bind tightest, then ``since``, ``and``, ``or``,
``->``. The reader is bounded: no input makes it recurse or run without limit.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from typing import TypeVar

import msgspec

from m2c.diagnostics import DiagnosticLog, Position
from m2c.language.expressions import Binary, Expression, Literal, Logical, Node, Unary, Variable
from m2c.language.parsing import parse_expression
from m2c.language.text import expression_text
from moon.properties.formula import (
    EVER,
    FALSE,
    LONGEST_TICKS,
    TICKS_PER_SECOND,
    TRUE,
    And,
    Formula,
    Historically,
    Implies,
    Interval,
    Not,
    Once,
    Or,
    Predicate,
    Rise,
    Since,
    has_rise,
)

_Part = TypeVar("_Part", bound=Node)

MAX_LENGTH = 20_000
"""Characters; the longest published formula has 90."""
MAX_DEPTH = 40
"""Operators inside each other: keeps every walk over the tree far from Python's recursion limit."""
MAX_OPERATORS = 2_000
MAX_PREDICATE_OPERATORS = 60
"""Brackets, dots and operators in one predicate: every walk over it stays shallow."""

TIME_UNITS = {
    "ns": 1,
    "us": 10**3,
    "ms": 10**6,
    "s": 10**9,
    "min": 60 * 10**9,
    "m": 60 * 10**9,
    "h": 3600 * 10**9,
}
"""Ticks of dense time in each."""
TIME_UNITS_HINT = "ns, us, ms, s, min or h"
_TOKEN = re.compile(
    r"""(?P<blank>\s+)|(?P<braces>\{)|(?P<symbol>->|&&|\|\||[!()\[\]:])
    |(?P<number>\d+(?:\.\d+)?)(?P<unit>[A-Za-z]*)|(?P<word>[A-Za-z_]\w*)""",
    re.VERBOSE | re.ASCII,
)
_WORDS = {
    **{"historically": "H", "H": "H", "once": "P", "P": "P", "O": "P", "since": "S", "S": "S"},
    **{"rises": "rises", "falls": "falls"},
    **{"not": "!", "and": "&&", "or": "||", "implies": "->", "true": "true", "false": "false"},
}
_REFUSED = {
    **dict.fromkeys(("pre", "Y", "previous"), "`previous` has no meaning in dense time"),
    **dict.fromkeys(("exists", "forall", "E", "A"), "quantified references are not supported"),
}


class FormulaError(ValueError):
    """A formula that cannot be read. ``offset`` counts characters from 0."""

    def __init__(self, message: str, offset: int, hint: str = "") -> None:
        self.message, self.offset, self.hint = message, offset, hint
        super().__init__(f"column {offset + 1}: {message}" + (f"; {hint}" if hint else ""))


class _Token(msgspec.Struct, frozen=True):
    kind: str
    text: str
    offset: int
    unit: str = ""


def parse_formula(
    source: str,
    ticks_per_unit: int = TICKS_PER_SECOND,
    resolve: Callable[[str, int], Formula | None] | None = None,
) -> Formula:
    """The formula that ``source`` says.

    Args:
        source: the text.
        ticks_per_unit: ticks of a bound without a unit (``[a:b]`` is in seconds unless this says so).
        resolve: ``resolve(text, offset)`` may replace the contents of braces by a formula (named
            predicates of a file); None leaves it to the expression language.

    Raises:
        FormulaError: it is not a formula; says where and what would be right.
    """
    return _Parser(source, ticks_per_unit, resolve).parse()


def condition(
    text: str,
    offset: int = 0,
    resolve: Callable[[str, int], Formula | None] | None = None,
) -> Formula:
    """The formula of the contents of braces: an expression, or ``key: value`` pairs, by commas.

    Raises:
        FormulaError: not an expression of the models' language.
    """
    parts = []
    for part, start in _split(text, ","):
        named = resolve(part.strip(), offset + start) if resolve is not None else None
        parts.append(named if named is not None else _pair(part, offset + start, resolve))
    return parts[0] if len(parts) == 1 else And(tuple(parts))


def edge(which: str, formula: Formula, offset: int = 0) -> Rise:
    """Where ``formula`` becomes true (``which`` is ``rises``) or false (``falls``).

    Raises:
        FormulaError: it says of itself where something becomes true or false; ``offset`` is where.
    """
    if has_rise(formula):
        what = f"`{which}` of what holds for an instant only"
        raise FormulaError(what, offset, "leave one of `rises` and `falls` out")
    return Rise(formula if which == "rises" else Not(formula))


def _pair(text: str, offset: int, resolve: Callable[[str, int], Formula | None] | None) -> Formula:
    pieces = _split(text, ":")
    if len(pieces) == 2 and "?" not in text:
        if pieces[1][0].strip() == "*":
            raise FormulaError(
                "`*` is not supported", offset + pieces[1][1], "compare with a value"
            )
        left = _expression(pieces[0][0], offset)
        right = _expression(pieces[1][0], offset + pieces[1][1])
        return spread(Binary(operator="==", left=left, right=right), resolve)
    return spread(_expression(text, offset), resolve)


def _expression(text: str, offset: int) -> Expression:
    if sum(text.count(mark) for mark in "([{.&|=<>+-*/%!?~") > MAX_PREDICATE_OPERATORS:
        message = f"a predicate has more than {MAX_PREDICATE_OPERATORS} operators"
        raise FormulaError(message, offset, "split it with `and` and `or`")
    log = DiagnosticLog()
    found = parse_expression(text, Position("", 1, 1), "", log)
    if found is None:
        first = log.diagnostics[0]
        raise FormulaError(first.message, offset + max(0, first.position.column - 1), first.hint)
    return found


def spread(
    expression: Expression, resolve: Callable[[str, int], Formula | None] | None = None
) -> Formula:
    """``expression`` with its ``&&``, ``||`` and ``!`` as formula operators, so that parts are shared."""
    match expression:
        case Logical(operator=operator, left=left, right=right):
            pair = (spread(left, resolve), spread(right, resolve))
            return And(pair) if operator == "&&" else Or(pair)
        case Unary(operator="!", operand=operand):
            return Not(spread(operand, resolve))
        case Literal(value=bool() as value):
            return TRUE if value else FALSE
        case Binary(operator="==" | "===", left=Variable() as left, right=Literal(value=True)):
            return spread(left, resolve)
        case Binary(operator="==" | "===", left=Variable() as left, right=Literal(value=False)):
            return Not(spread(left, resolve))
        case _:
            named = (
                resolve(expression_text(expression, json.dumps), 0) if resolve is not None else None
            )
            return named if named is not None else predicate(expression)


def predicate(expression: Expression) -> Predicate:
    """A predicate without positions, so that equal conditions are equal wherever they stand."""
    plain = _unplaced(expression)
    return Predicate(expression_text(plain, json.dumps), plain)


def _unplaced(expression: _Part) -> _Part:
    changes: dict[str, object] = {"position": Position("")}
    for name in expression.__struct_fields__:
        value = getattr(expression, name)
        if isinstance(value, Node):
            changes[name] = _unplaced(value)
        elif isinstance(value, tuple):
            changes[name] = tuple(
                _unplaced(item) if isinstance(item, Node) else (item[0], _unplaced(item[1]))
                for item in value
            )
    return msgspec.structs.replace(expression, **changes)


def _split(text: str, separator: str) -> list[tuple[str, int]]:
    """Pieces of ``text`` between top-level separators, with their offsets."""
    pieces, start, depth, quote = [], 0, 0, ""
    for index, letter in enumerate(text):
        if quote:
            quote = "" if letter == quote and text[index - 1] != "\\" else quote
        elif letter in "\"'":
            quote = letter
        elif letter in "([{":
            depth += 1
        elif letter in ")]}":
            depth -= 1
        elif letter == separator and depth == 0:
            pieces.append((text[start:index], start))
            start = index + 1
    pieces.append((text[start:], start))
    return pieces


class _Parser:
    """Recursive descent; ``_depth`` bounds the recursion."""

    def __init__(
        self,
        source: str,
        ticks_per_unit: int,
        resolve: Callable[[str, int], Formula | None] | None,
    ) -> None:
        if len(source) > MAX_LENGTH:
            raise FormulaError(f"longer than {MAX_LENGTH} characters", MAX_LENGTH)
        self._source = source
        self._ticks_per_unit = ticks_per_unit
        self._resolve = resolve
        self._tokens = self._tokenise()
        self._next = 0
        self._depth = 0

    def parse(self) -> Formula:
        if self._peek().kind == "end":
            raise FormulaError("the formula is empty", 0, "write e.g. historically {p}")
        formula = self._implication()
        token = self._peek()
        if token.kind != "end":
            raise FormulaError(
                f"`{token.text}` is one too many here", token.offset, "an operator or the end"
            )
        return formula

    def _tokenise(self) -> list[_Token]:
        tokens: list[_Token] = []
        source, at = self._source, 0
        while at < len(source):
            match = _TOKEN.match(source, at)
            if match is None:
                raise FormulaError(f"`{source[at]}` does not belong in a formula", at)
            kind = match.lastgroup or ""
            if kind == "braces":
                end = self._closing(at)
                tokens.append(_Token("predicate", source[at + 1 : end], at))
                at = end + 1
                continue
            if kind == "symbol":
                tokens.append(_Token(match[0], match[0], at))
            elif match["number"]:
                tokens.append(_Token("number", match["number"], at, match["unit"]))
            elif kind == "word":
                tokens.append(self._word(match[0], at))
            if len(tokens) > 4 * MAX_OPERATORS:
                raise FormulaError(f"more than {MAX_OPERATORS} operators", at)
            at = match.end()
        tokens.append(_Token("end", "", len(source)))
        return tokens

    def _word(self, word: str, at: int) -> _Token:
        if word in _WORDS:
            return _Token(_WORDS[word], word, at)
        if word == "inf":
            return _Token("inf", word, at)
        if word in _REFUSED:
            raise FormulaError(f"`{word}`: {_REFUSED[word]}", at)
        raise FormulaError(f"`{word}` is not an operator", at, f"a predicate is written {{{word}}}")

    def _closing(self, at: int) -> int:
        depth, quote = 0, ""
        for index in range(at, len(self._source)):
            letter = self._source[index]
            if quote:
                quote = "" if letter == quote else quote
            elif letter in "\"'":
                quote = letter
            elif letter == "{":
                depth += 1
            elif letter == "}":
                depth -= 1
                if depth == 0:
                    return index
        raise FormulaError("`{` is not closed", at, "a predicate is written {x > 3}")

    def _peek(self) -> _Token:
        return self._tokens[self._next]

    def _take(self, kind: str) -> _Token | None:
        token = self._tokens[self._next]
        if token.kind != kind:
            return None
        self._next += 1
        return token

    def _expect(self, kind: str, hint: str) -> _Token:
        token = self._take(kind)
        if token is None:
            here = self._peek()
            seen = f"`{here.text}`" if here.kind != "end" else "the end"
            raise FormulaError(f"`{kind}` expected, found {seen}", here.offset, hint)
        return token

    def _deeper(self, offset: int) -> None:
        self._depth += 1
        if self._depth > MAX_DEPTH:
            raise FormulaError(f"nested more than {MAX_DEPTH} deep", offset)

    def _implication(self) -> Formula:
        self._deeper(self._peek().offset)
        left = self._disjunction()
        if self._take("->") is not None:
            left = Implies(left, self._implication())
        self._depth -= 1
        return left

    def _disjunction(self) -> Formula:
        parts = [self._conjunction()]
        while self._take("||") is not None:
            parts.append(self._conjunction())
        return parts[0] if len(parts) == 1 else Or(tuple(parts))

    def _conjunction(self) -> Formula:
        parts = [self._since()]
        while self._take("&&") is not None:
            parts.append(self._since())
        return parts[0] if len(parts) == 1 else And(tuple(parts))

    def _since(self) -> Formula:
        left = self._unary()
        if self._take("S") is None:
            return left
        interval = self._interval()
        right = self._unary()
        if self._peek().kind == "S":
            raise FormulaError(
                "`since` after `since`",
                self._peek().offset,
                "say with parentheses which comes first",
            )
        return Since(left, right, interval)

    def _unary(self) -> Formula:
        token = self._peek()
        self._deeper(token.offset)
        self._next += 1
        result: Formula
        match token.kind:
            case "!":
                result = Not(self._unary())
            case "P":
                interval = self._interval()
                result = Once(self._unary(), interval)
            case "H":
                interval = self._interval()
                result = Historically(self._unary(), interval)
            case "rises" | "falls":
                result = edge(token.kind, self._unary(), token.offset)
            case "(":
                result = self._implication()
                self._expect(")", "close the parenthesis")
            case "true":
                result = TRUE
            case "false":
                result = FALSE
            case "predicate":
                result = condition(token.text, token.offset + 1, self._resolve)
            case _:
                self._next -= 1
                seen = f"`{token.text}`" if token.kind != "end" else "the end"
                raise FormulaError(
                    f"a formula expected, found {seen}",
                    token.offset,
                    "a predicate {x > 3}, true, false, not, once, historically or (",
                )
        self._depth -= 1
        return result

    def _interval(self) -> Interval:
        opening = self._take("[")
        if opening is None:
            return EVER
        lower = self._bound()
        self._expect(":", "a bound is written [a:b], [a:] or [:b]")
        upper = None if self._take("inf") is not None else self._bound()
        self._expect("]", "a bound is written [a:b], [a:] or [:b]")
        if lower is None and upper is None and self._tokens[self._next - 2].kind != "inf":
            raise FormulaError("neither end of the bound is given", opening.offset, "leave [:] out")
        if upper is not None and upper < (lower or 0):
            raise FormulaError(
                "the bound ends before it begins", opening.offset, "[a:b] needs a <= b"
            )
        return Interval(lower or 0, upper)

    def _bound(self) -> int | None:
        token = self._take("number")
        if token is None:
            return None
        if token.unit and token.unit not in TIME_UNITS:
            raise FormulaError(
                f"`{token.unit}` is not a unit of time", token.offset, TIME_UNITS_HINT
            )
        scale = TIME_UNITS[token.unit] if token.unit else self._ticks_per_unit
        if token.unit and self._ticks_per_unit != TICKS_PER_SECOND:
            raise FormulaError("steps have no unit", token.offset)
        return ticks(token.text, scale, token.offset)


def ticks(text: str, scale: int, offset: int = 0) -> int:
    """The decimal ``text`` times ``scale``, exactly.

    Raises:
        FormulaError: negative, not a number, not a whole number of ticks, or beyond a hundred years.
    """
    match = re.fullmatch(r"(\d+)(?:\.(\d+))?", text.strip(), re.ASCII)
    if match is None:
        raise FormulaError(f"`{text}` is not a time", offset, "a number such as 5 or 0.5")
    fraction = (match[2] or "").rstrip("0")
    if len(match[1]) + len(fraction) > 40:
        raise FormulaError("the bound has too many digits", offset)
    whole: int = 10 ** len(fraction)
    value, rest = divmod(int(match[1] + fraction) * scale, whole)
    if rest:
        raise FormulaError(f"{text} is not a whole number of ticks", offset)
    if value > LONGEST_TICKS:
        raise FormulaError(f"{text} is more than a hundred years", offset)
    return value
