"""Parsing expressions: what the sub-language has, and what is said of everything else."""

from __future__ import annotations

import math

import pytest

from m2c.language.expressions import (
    ArrayFrom,
    ArrayLiteral,
    Binary,
    Conditional,
    EventData,
    Expression,
    Index,
    Literal,
    Logical,
    MathCall,
    MathConstant,
    Member,
    ObjectLiteral,
    Parameter,
    Unary,
    Variable,
    children,
)
from m2c.language.parsing import MAX_LENGTH, parse_expression, parse_location
from m2c.model import DiagnosticLog, Position

AT = Position("m", 3, 10)
FROM = "Array.from({length: n}, () => value), the function with (_, i) where it needs the index [unsupported-expression]"
HINT = "literals, arrays, objects, members, indices, operators, ?: and Math.* are in it"


def parse(text: str) -> tuple[Expression | None, list[str]]:
    log = DiagnosticLog()
    return parse_expression(text, AT, "log", log), [str(found) for found in log.diagnostics]


def shape(node: Expression) -> object:
    """A tree without positions, to compare with."""
    match node:
        case Literal(value=value):
            return value
        case Variable(name=name) | MathConstant(name=name):
            return name
        case EventData(part=part):
            return ("event", part)
        case Member(object=inner, name=name):
            return (".", shape(inner), name)
        case Index():
            return ("[]", *(shape(child) for child in children(node)))
        case Unary(operator=operator) | Binary(operator=operator) | Logical(operator=operator):
            return (operator, *(shape(child) for child in children(node)))
        case Conditional():
            return ("?", *(shape(child) for child in children(node)))
        case MathCall(function=function):
            return (function, *(shape(child) for child in children(node)))
        case Parameter(name=name, depth=depth):
            return (name, depth)
        case ArrayFrom(index=index):
            return ("from", index, *(shape(child) for child in children(node)))
        case ArrayLiteral():
            return [shape(child) for child in children(node)]
        case ObjectLiteral(entries=entries):
            return {key: shape(value) for key, value in entries}
        case _:
            raise AssertionError(node)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("1", 1),
        ("0x10", 16),
        ("1.5", 1.5),
        (".5", 0.5),
        ("1e3", 1000),
        ("1e300", 1e300),
        ("1e999", math.inf),
        ("9223372036854775807", 2**63 - 1),
        ("18446744073709551615", 2**64 - 1),
        ("9" * 400, math.inf),
        ("0x" + "f" * 400, math.inf),
        ("'\\ud83d\\ude00'", "\U0001f600"),
        ("Infinity", math.inf),
        ("'it\\'s'", "it's"),
        ('"x"', "x"),
        ("true", True),
        ("True", True),
        ("False", False),
        ("null", None),
        ("undefined", None),
        ("a", "a"),
        ("  a  ", "a"),
        ("_private", "_private"),
        ("-1", ("-", 1)),
        ("-0", ("-", 0)),
        ("!a", ("!", "a")),
        ("typeof a", ("typeof", "a")),
        ("a + b * c", ("+", "a", ("*", "b", "c"))),
        ("a - b - c", ("-", ("-", "a", "b"), "c")),
        ("a ** b ** c", ("**", "a", ("**", "b", "c"))),
        ("a === b", ("===", "a", "b")),
        ("a != b", ("!=", "a", "b")),
        ("a && b || c", ("||", ("&&", "a", "b"), "c")),
        ("a ? b : c ? d : e", ("?", "a", "b", ("?", "c", "d", "e"))),
        ("a.b.c", (".", (".", "a", "b"), "c")),
        ("a[0].b", (".", ("[]", "a", 0), "b")),
        ("a['b']", ("[]", "a", "b")),
        ("a.length", (".", "a", "length")),
        ("[1, [a]]", [1, ["a"]]),
        ("{x: 1, 'y': {z: a}}", {"x": 1, "y": {"z": "a"}}),
        ("{}", {}),
        ("Math.PI", "PI"),
        ("Math.max(a, 1, b)", ("max", "a", 1, "b")),
        ("Math.random()", ("random",)),
        ("_msg", ("event", "data")),
        ("_msg.x", (".", ("event", "data"), "x")),
        ("_req.x", (".", ("event", "data"), "x")),
        ("_res.x", (".", ("event", "data"), "x")),
        ("_goal.x", (".", ("event", "data"), "x")),
        ("_feedback.x", (".", ("event", "data"), "x")),
        ("_wrapped_result.result.x", (".", ("event", "data"), "x")),
        ("_event.data.x", (".", ("event", "data"), "x")),
        ("_action.goal.x", (".", ("event", "data"), "x")),
        ("_wrapped_result.code", ("event", "code")),
        ("_action.goal_id", ("event", "goal_id")),
        ("_event.thread_id", ("event", "thread_id")),
        ("_event.name", ("event", "name")),
        ("_bt.status", ("event", "status")),
        ("Array.from({length: 3}, () => 0)", ("from", "", 3, 0)),
        ("Array.from({'length': n}, _ => a + 1)", ("from", "", "n", ("+", "a", 1))),
        ("Array.from({length: n}, (_, i) => i)", ("from", "i", "n", ("i", 0))),
        ("Array.from({length: 3}, (_, a) => a)[a]", ("[]", ("from", "a", 3, ("a", 0)), "a")),
        ("Array.from({length: i}, (_, i) => ({x: i}))", ("from", "i", "i", {"x": ("i", 0)})),
        (
            "Array.from({length: 2}, (_, i) => Array.from({length: i}, (_, j) => i * j))",
            ("from", "i", 2, ("from", "j", ("i", 0), ("*", ("i", 0), ("j", 1)))),
        ),
        (
            "Array.from({length: 2}, (_, i) => Array.from({length: 2}, (_, i) => i))",
            ("from", "i", 2, ("from", "i", 2, ("i", 1))),
        ),
        ("a // why", "a"),
    ],
)
def test_the_sub_language_is_parsed_into_its_tree(text: str, expected: object) -> None:
    expression, findings = parse(text)
    assert findings == []
    assert expression is not None
    assert shape(expression) == expected


def test_whole_numbers_beyond_every_integer_type_are_floats() -> None:
    for text, kind in (("18446744073709551615", int), ("1e20", float), ("1" * 400, float)):
        expression, _ = parse(text)
        assert isinstance(expression, Literal)
        assert type(expression.value) is kind


@pytest.mark.parametrize(
    ("text", "column", "message"),
    [
        ("", 10, "``: not an expression: it is empty; write a value, a variable or a formula [bad-expression]"),
        ("   ", 13, "``: not an expression: it is empty; write a value, a variable or a formula [bad-expression]"),
        ("1 +", 13, "`1 +`: not an expression: Unexpected token ) [bad-expression]"),
        ("  1 +", 15, "`1 +`: not an expression: Unexpected token ) [bad-expression]"),
        ("a b", 12, "`a b`: not an expression: Unexpected identifier [bad-expression]"),
        ("a or b", None, "`a or b`: not an expression: Unexpected identifier; write `||` for `or` [bad-expression]"),
        ("a == 1 and b", None, "not an expression: Unexpected identifier; write `&&` for `and` [bad-expression]"),
        ("not a", None, "not an expression: Unexpected identifier; write `!` for `not` [bad-expression]"),
        ("origin land", None, "not an expression: Unexpected identifier [bad-expression]"),
        ("'x", 10, "`'x`: not an expression: Unexpected token ILLEGAL [bad-expression]"),
        ("a; b", 11, "`a; b`: not an expression: Unexpected token ; [bad-expression]"),
        ("a) + (b", 11, "`a) + (b`: not an expression: Unexpected token ) [bad-expression]"),
        ("1); f(", None, "; one expression, without `;` [bad-expression]"),
        ("x = 1", 10, "`x = 1`: an assignment is not an expression; use <assign>, or == to compare [unsupported-expression]"),
        ("f(1)", 10, f"`f(1)`: call `f(1)` is outside the sub-language; {HINT} [unsupported-expression]"),
        ("1 + f(1)", 14, f"`1 + f(1)`: call `f(1)` is outside the sub-language; {HINT} [unsupported-expression]"),
        ("a.push(1)", 10, f"`a.push(1)`: call `a.push(1)` is outside the sub-language; {HINT} [unsupported-expression]"),
        ("new Date()", 10, f"`new Date()`: new `new Date()` is outside the sub-language; {HINT} [unsupported-expression]"),
        ("x => x", 10, f"`x => x`: arrow function `x => x` is outside the sub-language; {HINT} [unsupported-expression]"),
        ("function(){}", 10, f"`function(){{}}`: function `function(){{}}` is outside the sub-language; {HINT} [unsupported-expression]"),
        ("/x/", 10, f"`/x/`: literal `/x/` is outside the sub-language; {HINT} [unsupported-expression]"),
        ("'\\ud83d'", 10, "`'\\ud83d'`: half a surrogate pair is no character; write the character itself, or both halves [unsupported-expression]"),
        ("'a\\0'", 10, "`'a\\0'`: the character NUL in a text; strings of ROS 2 end at NUL: leave it out [unsupported-expression]"),
        ("1n", 10, f"`1n`: literal `1n` is outside the sub-language; {HINT} [unsupported-expression]"),
        ("`x`", 10, f"``x``: template literal ``x`` is outside the sub-language; {HINT} [unsupported-expression]"),
        ("a++", 10, f"`a++`: update `a++` is outside the sub-language; {HINT} [unsupported-expression]"),
        ("a & b", 10, f"`a & b`: binary `a & b` is outside the sub-language; {HINT} [unsupported-expression]"),
        ("~a", 10, f"`~a`: unary `~a` is outside the sub-language; {HINT} [unsupported-expression]"),
        ("a in b", 10, f"`a in b`: binary `a in b` is outside the sub-language; {HINT} [unsupported-expression]"),
        ("a ?? b", 10, f"`a ?? b`: logical `a ?? b` is outside the sub-language; {HINT} [unsupported-expression]"),
        ("a, b", 10, f"`a, b`: sequence `a, b` is outside the sub-language; {HINT} [unsupported-expression]"),
        ("[...a]", 10, f"`[...a]`: array `[...a]` is outside the sub-language; {HINT} [unsupported-expression]"),
        ("[1,,2]", 10, f"`[1,,2]`: array `[1,,2]` is outside the sub-language; {HINT} [unsupported-expression]"),
        ("({[a]: 1})", None, f"is outside the sub-language; {HINT} [unsupported-expression]"),
        ("this", 10, f"`this`: this `this` is outside the sub-language; {HINT} [unsupported-expression]"),
        ("Math.foo(1)", 10, "`Math.foo(1)`: `Math.foo` is not known; see docs/language.md [unsupported-expression]"),
        ("Math.max", 10, f"`Math.max`: `Math.max` is not a constant; {HINT} [unsupported-expression]"),
        ("Math.floor()", 10, f"`Math.floor()`: Math.floor takes 1 arguments, not 0; {HINT} [unsupported-expression]"),
        ("Math.pow(1)", 10, f"`Math.pow(1)`: Math.pow takes 2 arguments, not 1; {HINT} [unsupported-expression]"),
        ("Array.from([1, 2])", 10, f"`Array.from([1, 2])`: Array.from takes `{{length: n}}` and a function; {FROM}"),
        ("Array.from()", 10, f"`Array.from()`: Array.from takes `{{length: n}}` and a function; {FROM}"),
        ("Array.from({size: 3}, () => 1)", 10, f"`Array.from({{size: 3}}, () => 1)`: Array.from takes `{{length: n}}` and a function; {FROM}"),
        ("Array.from({...a}, () => 1)", 10, f"`Array.from({{...a}}, () => 1)`: Array.from takes `{{length: n}}` and a function; {FROM}"),
        ("Array.from({length: 3})", 10, f"`Array.from({{length: 3}})`: Array.from takes an arrow function of one expression; {FROM}"),
        ("Array.from({length: 3}, f)", 10, f"`Array.from({{length: 3}}, f)`: Array.from takes an arrow function of one expression; {FROM}"),
        ("Array.from({length: 3}, async () => 1)", 10, f"`Array.from({{length: 3}}, async () => 1)`: Array.from takes an arrow function of one expression; {FROM}"),
        ("Array.from({length: 3}, () => {1})", 10, f"`Array.from({{length: 3}}, () => {{1}})`: Array.from takes an arrow function of one expression; {FROM}"),
        ("Array.from({length: 3}, (_, i = 1) => i)", 10, f"`Array.from({{length: 3}}, (_, i = 1) => i)`: Array.from takes an arrow function of one expression; {FROM}"),
        ("Array.from({length: 3}, () => 1, a)", 10, f"`Array.from({{length: 3}}, () => 1, a)`: Array.from takes an arrow function of one expression; {FROM}"),
        ("Array.from({length: 3}, x => x)", 39, "`Array.from({length: 3}, x => x)`: `x` is undefined: `{length: n}` has no elements; the second parameter is the index, (_, i) => … [unsupported-expression]"),
        ("Array.from({length: 3}, (_, _msg) => 1)", 34, "`Array.from({length: 3}, (_, _msg) => 1)`: a parameter called `_msg`; name it otherwise [unsupported-expression]"),
        ("_event", 10, "`_event`: `_event` is not a value; use a field of it, `_event.x` [unsupported-expression]"),
        ("_event.x", 10, "`_event.x`: `_event.x` does not exist; _event has data, name, goal_id and thread_id [unsupported-expression]"),
        ("_bt.x", 10, "`_bt.x`: `_bt.x` does not exist; _bt has status [unsupported-expression]"),
        ("!" * 100 + "a", 50, f"`{'!' * 77}...`: nested more than 40 deep [unsupported-expression]"),
        ("(" * 100 + "a" + ")" * 100, 50, f"`{'(' * 77}...`: nested more than 40 deep [unsupported-expression]"),
        ("a?" * 50 + "b" + ":c" * 50, 10, f"`{('a?' * 50)[:77]}...`: nested more than 40 deep [unsupported-expression]"),
        ("+".join("a" * 500), 10, f"`{('a+' * 50)[:77]}...`: more than 400 operators [unsupported-expression]"),
        ("a" * (MAX_LENGTH + 1) + "!", 10, f"`{'a' * 77}...`: longer than 4096 characters [unsupported-expression]"),
    ],
)  # fmt: skip
def test_everything_else_is_refused_with_its_place(
    text: str, column: int | None, message: str
) -> None:
    expression, findings = parse(text)
    assert expression is None
    (found,) = findings
    if column is None:  # the place is esprima's
        assert found.startswith("m:3:")
        assert found.endswith(message)
    else:
        assert found == f"m:3:{column}: error: <log>: {message}"


def test_the_place_of_a_part_is_where_it_stands() -> None:
    expression, _ = parse("  n + levle")
    assert isinstance(expression, Binary)
    assert expression.right.position == Position("m", 3, 16)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a", "a"),
        ("a.b", (".", "a", "b")),
        ("a[i]", ("[]", "a", "i")),
        ("a.b[i + 1].c", (".", ("[]", (".", "a", "b"), ("+", "i", 1)), "c")),
        ("a[a.length]", ("[]", "a", (".", "a", "length"))),
        ("a.length", (".", "a", "length")),
    ],
)
def test_a_location_is_a_variable_or_a_part_of_one(text: str, expected: object) -> None:
    log = DiagnosticLog()
    location = parse_location(text, AT, "assign", log)
    assert location is not None
    assert shape(location) == expected


@pytest.mark.parametrize("text", ["1", "a + b", "_msg.x", "Math.PI", "[a]", "(a ? b : c).d"])
def test_nothing_else_can_be_assigned_to(text: str) -> None:
    log = DiagnosticLog()
    assert parse_location(text, AT, "assign", log) is None
    assert [str(found) for found in log.diagnostics] == [
        f"m:3:10: error: <assign>: `{text}` cannot be assigned to; a location is a variable, a field of "
        "one (a.b) or an element of one (a[i]) [bad-location]"
    ]


@pytest.mark.parametrize("text", [r"'\ud83d\ude00'", r"'\u{1f600}'", "'😀'"])
def test_a_character_may_be_written_as_two_halves(text: str) -> None:
    tree, said = parse(text)
    assert (tree and shape(tree), said) == ("😀", [])


@pytest.mark.parametrize("text", [r"'\ud83d'", r"'\ude00\ud83d'", r"{'\ud83d': 1}"])
def test_half_a_character_is_refused_as_no_middleware_can_carry_it(text: str) -> None:
    tree, said = parse(text)
    assert tree is None
    (found,) = said
    assert found.endswith(
        "half a surrogate pair is no character; write the character itself, or both halves "
        "[unsupported-expression]"
    )
