"""Parsing expressions: ECMAScript text to the tree of :mod:`m2c.language.expressions`.

The grammar work is esprima's (standard ESTree, ECMA-262); this module admits the sub-language that
models use and reports everything else. Nothing is ever evaluated here.
"""

from __future__ import annotations

import re
from collections.abc import Collection
from typing import Any, cast

from m2c.diagnostics import DiagnosticLog, Position
from m2c.language.conversion import MAX_LENGTH as LONGEST_ARRAY
from m2c.language.conversion import to_double, to_string
from m2c.language.expressions import (
    ArrayFrom,
    ArrayLiteral,
    Binary,
    Conditional,
    EventData,
    EventPart,
    Expression,
    Index,
    InState,
    Literal,
    Location,
    Logical,
    MathCall,
    MathConstant,
    Member,
    ObjectLiteral,
    Parameter,
    Unary,
    Variable,
    nodes,
)
from m2c.language.operators import BINARY, LOGICAL, PREFIX

MAX_LENGTH = 4096
"""Characters in one expression; the longest published one has 120."""
MAX_NESTING = 40
"""Brackets open at once: keeps the parser's recursion bounded whatever the input."""
MOST_NESTED = 1000
"""Elements that ``Array.from`` makes inside another one, and around one: together a million."""

MATH_FUNCTIONS = {
    **dict.fromkeys(
        (
            *("abs", "acos", "asin", "atan", "cbrt", "ceil", "cos", "exp", "floor", "log"),
            *("log10", "log2", "round", "sign", "sin", "sqrt", "tan", "trunc"),
        ),
        (1, 1),
    ),
    "atan2": (2, 2),
    "pow": (2, 2),
    "hypot": (0, 99),
    "max": (0, 99),
    "min": (0, 99),
    "random": (0, 0),
}
"""``Math`` functions with the least and the most arguments they take."""
MATH_CONSTANTS = ("E", "LN10", "LN2", "LOG10E", "LOG2E", "PI", "SQRT1_2", "SQRT2")

_DATA_ROOTS = {"_msg", "_req", "_res", "_feedback", "_goal", "_result"}
_ROOTS = {*_DATA_ROOTS, "_event", "_action", "_wrapped_result", "_bt"}
_EVENT_PARTS: tuple[EventPart, ...] = ("goal_id", "thread_id", "code", "status", "name")
_NAMED = {"undefined": None, "True": True, "False": False}

_LARGEST_INTEGER = 2**64
"""Literals beyond what an integer of ROS holds are numbers in floating point."""

_DIGITS = re.compile(r"[1-9][0-9]*\Z")
_SIMPLE_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*\Z")
_SIMPLE_INTEGER = re.compile(r"-?(0|[1-9][0-9]{0,14})\Z")
_RESERVED = {
    "true",
    "false",
    "null",
    "this",
    "typeof",
    "new",
    "delete",
    "void",
    "in",
    "Math",
    "Infinity",
    "NaN",
}


class _Outside(Exception):
    """The text is not in the sub-language."""

    def __init__(self, message: str, hint: str = "", offset: int = 0) -> None:
        super().__init__(message)
        self.message = message
        self.hint = hint
        self.offset = offset


def parse_expression(
    text: str,
    position: Position,
    element: str,
    log: DiagnosticLog,
    parts_in_data: Collection[EventPart] = (),
    has_states: bool = False,
) -> Expression | None:
    """Parse ``text``, which starts at ``position`` in an attribute of ``element``.

    ``parts_in_data`` are parts of the event that ``_event.data`` has as well; ``has_states``: it belongs to
    a machine, so that ``In('state')`` may be asked.

    Returns None after reporting rule ``bad-expression`` (not ECMAScript) or
    ``unsupported-expression`` (outside the sub-language).
    """
    stripped = text.strip()
    simple = _parse_simple(stripped, position)
    if simple is not None:
        return simple
    lead = len(text) - len(text.lstrip())
    try:
        _bound(stripped)
        tree = _parse_text(stripped)
        return _Converter(stripped, position, lead, parts_in_data, has_states).convert(tree)
    except _Outside as outside:
        at = _shift(position, lead + outside.offset)
        shown = stripped if len(stripped) <= 80 else stripped[:77] + "..."
        rule = (
            "bad-expression" if outside.message.startswith("not an") else "unsupported-expression"
        )
        log.error(rule, at, element, f"`{shown}`: {outside.message}", outside.hint)
        return None


def python_boolean(node: Expression, text: str) -> str:
    """``True`` or ``False`` if ``text``, which begins with ``node``, says it as Python does; else ""."""
    if not (isinstance(node, Literal) and isinstance(node.value, bool)):
        return ""
    return next((word for word in ("True", "False") if text.startswith(word)), "")


def parse_location(
    text: str, position: Position, element: str, log: DiagnosticLog
) -> Location | None:
    """Parse an assignment's location: ``a``, ``a.b``, ``a[i]`` and their combinations."""
    expression = parse_expression(text, position, element, log)
    if expression is None:
        return None
    root: Expression = expression
    while isinstance(root, Member | Index):
        root = root.object
    if isinstance(root, Variable) and isinstance(expression, Variable | Member | Index):
        return expression
    log.error(
        "bad-location",
        position,
        element,
        f"`{text.strip()}` cannot be assigned to",
        "a location is a variable, a field of one (a.b) or an element of one (a[i])",
    )
    return None


def _parse_simple(text: str, position: Position) -> Expression | None:
    """The four in five expressions that are one name or one integer, without loading esprima."""
    if _SIMPLE_NAME.match(text) and text not in _RESERVED:
        if text in _NAMED:
            return Literal(value=_NAMED[text], position=position)
        return Variable(name=text, position=position)
    if _SIMPLE_INTEGER.match(text) and text != "-0":
        value = int(text)
        literal = Literal(value=abs(value), position=position)
        return Unary(operator="-", operand=literal, position=position) if value < 0 else literal
    if text in ("true", "false"):
        return Literal(value=text == "true", position=position)
    return None


_OPERATORS = {"and": "&&", "or": "||", "not": "!"}
_WORDED = re.compile(rf"\b(?:{'|'.join(_OPERATORS)})\b")
"""Operators as other languages write them, which no expression has."""


def _bound(text: str) -> None:
    if not text:
        raise _Outside("not an expression: it is empty", "write a value, a variable or a formula")
    if len(text) > MAX_LENGTH:
        raise _Outside(f"longer than {MAX_LENGTH} characters")
    depth = 0
    unary = 0
    for offset, character in enumerate(text):
        depth += (character in "([{") - (character in ")]}")
        unary = unary + 1 if character in "!-+~ " else 0
        if depth > MAX_NESTING or unary > MAX_NESTING:
            raise _Outside(f"nested more than {MAX_NESTING} deep", offset=offset)
    if text.count("?") > MAX_NESTING or text.count("typeof") > MAX_NESTING:
        raise _Outside(f"nested more than {MAX_NESTING} deep")
    if (
        sum(text.count(operator) for operator in ("+", "-", "*", "/", "%", "&&", "||", ".", "["))
        > 400
    ):
        raise _Outside("more than 400 operators")


def _parse_text(text: str) -> Any:
    import esprima  # 45 ms: only for expressions that are more than a name or an integer

    try:
        tree = esprima.parseScript(f"({text}\n)", range=True)
    except esprima.Error as error:
        reason = str(error).partition(": ")[2] or str(error)
        offset = max(0, min(error.index - 1, len(text)))
        word = _WORDED.search(text)
        hint = f"write `{_OPERATORS[word[0]]}` for `{word[0]}`" if word else ""
        raise _Outside(f"not an expression: {reason}", hint, offset=offset) from error
    if len(tree.body) != 1 or tree.body[0].type != "ExpressionStatement":
        raise _Outside("not an expression", "one expression, without `;`")
    expression = tree.body[0].expression
    if expression.range[0] == 0:  # `a) + (b` closed the bracket that was put around it
        raise _Outside("not an expression: Unexpected token )", offset=text.index(")"))
    return expression


def _shift(position: Position, columns: int) -> Position:
    return Position(position.file, position.line, position.column + columns)


class _Converter:
    """ESTree to our tree."""

    def __init__(
        self,
        text: str,
        position: Position,
        lead: int,
        parts_in_data: Collection[EventPart],
        has_states: bool,
    ) -> None:
        self._text = text
        self._start = _shift(position, lead)
        self._parts_in_data = parts_in_data
        self._has_states = has_states
        self._functions: list[tuple[str, ...]] = []
        """The parameters of the functions around the node that is being converted."""

    def convert(self, node: Any) -> Expression:
        method = getattr(self, f"_{node.type}", None)
        if method is None:
            raise self._unsupported(node)
        return cast("Expression", method(node))

    def _at(self, node: Any) -> Position:
        return _shift(self._start, node.range[0] - 1)

    def _unsupported(self, node: Any, what: str = "", hint: str = "") -> _Outside:
        snippet = self._text[node.range[0] - 1 : node.range[1] - 1]
        described = what or f"{_describe(node.type)} `{snippet}` is outside the sub-language"
        return _Outside(
            described,
            hint
            or "literals, arrays, objects, members, indices, operators, ?: and Math.* are in it",
            node.range[0] - 1,
        )

    def _Literal(self, node: Any) -> Expression:
        value = node.value
        big = isinstance(value, int | float) and node.raw.endswith("n")  # 1n; no hex digit is an n
        if node.regex is not None or big:
            raise self._unsupported(node)
        if _DIGITS.match(node.raw):
            value = int(node.raw)  # esprima rounds it to a double: 2**63 - 1 would not fit int64
        # esprima gives every whole number as an int, 1e300 with its 301 digits
        if isinstance(value, int) and not isinstance(value, bool) and abs(value) > _LARGEST_INTEGER:
            value = to_double(value)
        if isinstance(value, str):
            value = self._well_formed(node, value)
        return Literal(value=value, position=self._at(node))

    def _well_formed(self, node: Any, text: str) -> str:
        """``text`` with surrogate pairs joined; half a pair, and NUL, no message can carry."""
        try:
            joined = text.encode("utf-16", "surrogatepass").decode("utf-16")
        except UnicodeDecodeError:
            raise self._unsupported(
                node,
                "half a surrogate pair is no character",
                "write the character itself, or both halves",
            ) from None
        if "\0" in joined:
            raise self._unsupported(
                node, "the character NUL in a text", "strings of ROS 2 end at NUL: leave it out"
            )
        return joined

    def _Identifier(self, node: Any) -> Expression:
        name = node.name
        for depth, parameters in reversed(list(enumerate(self._functions))):
            if name in parameters[1:]:
                return Parameter(name=name, depth=depth, position=self._at(node))
            if name in parameters:
                what = f"`{name}` is undefined: `{{length: n}}` has no elements"
                raise self._unsupported(
                    node, what, "the second parameter is the index, (_, i) => …"
                )
        if name in _NAMED:
            return Literal(value=_NAMED[name], position=self._at(node))
        if name in ("Infinity", "NaN"):
            return Literal(
                value=float("inf" if name == "Infinity" else "nan"), position=self._at(node)
            )
        if name in _DATA_ROOTS:
            return EventData(part="data", spelling=name, position=self._at(node))
        if name in _ROOTS:
            raise self._unsupported(
                node, f"`{name}` is not a value", f"use a field of it, `{name}.x`"
            )
        return Variable(name=name, position=self._at(node))

    def _MemberExpression(self, node: Any) -> Expression:
        if getattr(node, "optional", False):
            raise self._unsupported(node)
        if node.computed:
            return Index(
                object=self.convert(node.object),
                index=self.convert(node.property),
                position=self._at(node),
            )
        name = node.property.name
        inner = node.object
        if inner.type == "Identifier" and inner.name == "Math":
            if name in MATH_CONSTANTS:
                return MathConstant(name=name, position=self._at(node))
            raise self._unsupported(node, f"`Math.{name}` is not a constant")
        if inner.type == "Identifier" and inner.name in _ROOTS - _DATA_ROOTS:
            return self._event_member(node, inner.name, name)
        holder = self.convert(inner)
        if isinstance(holder, EventData) and holder.spelling == "_event.data":
            part = next((part for part in self._parts_in_data if part == name), None)
            if part is not None:
                return EventData(part=part, spelling=f"_event.data.{name}", position=self._at(node))
        return Member(object=holder, name=name, position=self._at(node))

    def _event_member(self, node: Any, root: str, name: str) -> Expression:
        at = self._at(node)
        spelling = f"{root}.{name}"
        if (root, name) in (("_event", "data"), ("_wrapped_result", "result"), ("_action", "goal")):
            return EventData(part="data", spelling=spelling, position=at)
        part = next((part for part in _EVENT_PARTS if part == name), None)
        if part is not None:
            return EventData(part=part, spelling=spelling, position=at)
        hint = {
            "_event": "_event has data, name, goal_id and thread_id",
            "_wrapped_result": "_wrapped_result has result and code",
            "_action": "_action has goal_id",
            "_bt": "_bt has status",
        }[root]
        raise self._unsupported(node, f"`{spelling}` does not exist", hint)

    def _CallExpression(self, node: Any) -> Expression:
        callee = node.callee
        if self._has_states and callee.type == "Identifier" and callee.name == "In":
            return self._in_state(node)
        owner = ""
        if callee.type == "MemberExpression" and not callee.computed:
            owner = callee.object.name if callee.object.type == "Identifier" else ""
        if owner == "Array" and callee.property.name == "from":
            return self._array_from(node)
        if owner != "Math":
            raise self._unsupported(node)
        name = callee.property.name
        if name not in MATH_FUNCTIONS:
            raise self._unsupported(node, f"`Math.{name}` is not known", "see docs/language.md")
        least, most = MATH_FUNCTIONS[name]
        if not least <= len(node.arguments) <= most:
            wanted = str(least) if least == most else f"at least {least}"
            raise self._unsupported(
                node, f"Math.{name} takes {wanted} arguments, not {len(node.arguments)}"
            )
        arguments = tuple(self.convert(argument) for argument in node.arguments)
        return MathCall(function=name, arguments=arguments, position=self._at(node))

    def _array_from(self, node: Any) -> Expression:
        """``Array.from({length: n}, () => item)``; the function may take ``(_, i)``."""
        form = "Array.from({length: n}, () => value), the function with (_, i) where it needs the index"
        given, function = (*node.arguments, None, None)[:2]
        named = [] if given is None or given.type != "ObjectExpression" else given.properties
        is_length = len(named) == 1 and named[0].type == "Property" and not named[0].computed
        if not is_length or "length" not in (named[0].key.name, named[0].key.value):
            raise self._unsupported(node, "Array.from takes `{length: n}` and a function", form)
        if (
            len(node.arguments) != 2
            or function.type != "ArrowFunctionExpression"
            or function.isAsync
            or not function.expression
            or len(function.params) > 2
            or any(item.type != "Identifier" for item in function.params)
        ):
            raise self._unsupported(
                node, "Array.from takes an arrow function of one expression", form
            )
        depth = len(self._functions)
        if depth > 1:
            raise self._unsupported(node, "Array.from inside two others")
        names = tuple(item.name for item in function.params)
        taken = next((name for name in names if name in _ROOTS or name in _RESERVED), None)
        if taken is not None:
            raise self._unsupported(function, f"a parameter called `{taken}`", "name it otherwise")
        length = self.convert(named[0].value)
        self._functions.append(names or ("",))
        item = self.convert(function.body)
        self._functions.pop()
        is_nested = depth > 0 or any(isinstance(inner, ArrayFrom) for inner in nodes(item))
        return ArrayFrom(
            length=length,
            item=item,
            index="".join(names[1:]),
            depth=depth,
            most=MOST_NESTED if is_nested else LONGEST_ARRAY,
            position=self._at(node),
        )

    def _in_state(self, node: Any) -> Expression:
        given = [self.convert(argument) for argument in node.arguments]
        if len(given) == 1 and isinstance(given[0], Literal) and isinstance(given[0].value, str):
            name = self._text[node.range[0] - 1 : node.range[1] - 1]
            return InState(name=name, state=given[0].value, position=self._at(node))
        hint = "write the id of a state in quotes, In('moving')"
        raise self._unsupported(node, "In takes the id of one state", hint)

    def _UnaryExpression(self, node: Any) -> Expression:
        if node.operator not in PREFIX:
            raise self._unsupported(node)
        return Unary(
            operator=node.operator, operand=self.convert(node.argument), position=self._at(node)
        )

    def _BinaryExpression(self, node: Any) -> Expression:
        if node.operator not in BINARY:
            raise self._unsupported(node)
        return Binary(
            operator=node.operator,
            left=self.convert(node.left),
            right=self.convert(node.right),
            position=self._at(node),
        )

    def _LogicalExpression(self, node: Any) -> Expression:
        if node.operator not in LOGICAL:
            raise self._unsupported(node)
        return Logical(
            operator=node.operator,
            left=self.convert(node.left),
            right=self.convert(node.right),
            position=self._at(node),
        )

    def _ConditionalExpression(self, node: Any) -> Expression:
        return Conditional(
            test=self.convert(node.test),
            then=self.convert(node.consequent),
            otherwise=self.convert(node.alternate),
            position=self._at(node),
        )

    def _ArrayExpression(self, node: Any) -> Expression:
        if any(item is None or item.type == "SpreadElement" for item in node.elements):
            raise self._unsupported(node)
        elements = tuple(self.convert(item) for item in node.elements)
        return ArrayLiteral(elements=elements, position=self._at(node))

    def _ObjectExpression(self, node: Any) -> Expression:
        entries = []
        for item in node.properties:
            if item.type != "Property" or item.computed or item.method or item.kind != "init":
                raise self._unsupported(item if item.range else node)
            named = item.key.type == "Identifier"
            key = item.key.name if named else self._well_formed(item.key, to_string(item.key.value))
            entries.append((key, self.convert(item.value)))
        return ObjectLiteral(entries=tuple(entries), position=self._at(node))

    def _AssignmentExpression(self, node: Any) -> Expression:
        raise self._unsupported(
            node, "an assignment is not an expression", "use <assign>, or == to compare"
        )


def _describe(kind: str) -> str:
    """``ArrowFunctionExpression`` as ``arrow function``."""
    words = re.findall(r"[A-Z][a-z]*", kind.removesuffix("Expression"))
    return " ".join(words).lower() or "this"
