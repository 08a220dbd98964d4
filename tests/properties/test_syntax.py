"""Reading formulas: MOON's and Reelay's spellings, exact places of faults, no input that hurts."""

from __future__ import annotations

import random

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from moon.properties.compiler import network_code
from moon.properties.describe import formula_deadline
from moon.properties.formula import TICKS_PER_SECOND, Interval, Once, Since, text
from moon.properties.monitor import PropertyMonitor
from moon.properties.network import build_network
from moon.properties.predicates import PredicateError
from moon.properties.syntax import MAX_DEPTH, FormulaError, parse_formula
from tests.properties.differential import random_formula

PUBLISHED = {
    "historically(({alarm} -> once{low_battery}) and not( not {alarm} since[5:] {low_battery}))": (
        "historically (({alarm} -> (once {low_battery})) and (not ((not {alarm}) since[5:] {low_battery})))"
    ),
    "historically( (once[2:]( {PICK} )) -> ( ({strength > 90.0}) or ({PLACE}) or ({IDLE}) ) )": (
        "historically ((once[2:] {PICK}) -> ({strength > 90} or {PLACE} or {IDLE}))"
    ),
    "historically( not ( (not {PLACE}) since[7:] (once {MOVE}) ) )": (
        "historically (not ((not {PLACE}) since[7:] (once {MOVE})))"
    ),
    "H ((P[50:] true) -> P[:30] { battery_level_published })": (
        "historically ((once[50:] true) -> (once[:30] {battery_level_published}))"
    ),
    "! P ( { !alarm } S[62:] { battery_level <= 30 } )": (
        "not (once ((not {alarm}) since[62:] {battery_level <= 30}))"
    ),
    "historically( (once[3:] (not {false}) ) -> (once[:3] {e} ) )": (
        "historically ((once[3:] (not false)) -> (once[:3] {e}))"
    ),
    '{mode: "Sport", speed > 20.5}': '{mode == "Sport"} and {speed > 20.5}',
}


@pytest.mark.parametrize("source", PUBLISHED)
def test_published_formulas_are_read(source):
    assert text(parse_formula(source)) == PUBLISHED[source]


@given(seed=st.integers(0, 2**40))
@settings(max_examples=300, deadline=None)
def test_the_text_of_a_formula_reads_as_the_formula(seed):
    choice = random.Random(seed)
    formula = parse_formula(random_formula(choice, 4))
    assert parse_formula(text(formula)) == formula


@pytest.mark.parametrize(
    ("source", "interval"),
    [
        ("once[1:2]{p}", Interval(10**9, 2 * 10**9)),
        ("once[0.5:]{p}", Interval(5 * 10**8, None)),
        ("once[:200ms]{p}", Interval(0, 2 * 10**8)),
        ("once[1ns:1us]{p}", Interval(1, 1000)),
        ("once[2:inf]{p}", Interval(2 * 10**9, None)),
    ],
)
def test_bounds_are_seconds_unless_they_say_otherwise(source, interval):
    formula = parse_formula(source)
    assert isinstance(formula, Once)
    assert formula.interval == interval


def test_unary_operators_bind_tighter_than_since():
    formula = parse_formula("not {p} since {q}")
    assert isinstance(formula, Since)
    assert text(formula) == "(not {p}) since {q}"


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("", "column 1: the formula is empty; write e.g. historically {p}"),
        ("p", "column 1: `p` is not an operator; a predicate is written {p}"),
        ("once[3:1]{p}", "column 5: the bound ends before it begins; [a:b] needs a <= b"),
        ("once[:]{p}", "column 5: neither end of the bound is given; leave [:] out"),
        ("once[-1:]{p}", "column 6: `-` does not belong in a formula"),
        ("once[1x:]{p}", "column 6: `x` is not a unit of time; ns, us, ms, s, min or h"),
        ("once[0.0000000001:]{p}", "column 6: 0.0000000001 is not a whole number of ticks"),
        ("once[99999999999:]{p}", "column 6: 99999999999 is more than a hundred years"),
        ("({p}", "column 5: `)` expected, found the end; close the parenthesis"),
        ("{p} {q}", "column 5: `q` is one too many here; an operator or the end"),
        (
            "{p} since {q} since {r}",
            "column 15: `since` after `since`; say with parentheses which comes first",
        ),
        ("{p", "column 1: `{` is not closed; a predicate is written {x > 3}"),
        ("pre {p}", "column 1: `pre`: `previous` has no meaning in dense time"),
        ("exists[x].{p}", "column 1: `exists`: quantified references are not supported"),
        ("{mode: *}", "column 7: `*` is not supported; compare with a value"),
        ("{p} and {x >}", "column 13: `x >`: not an expression: Unexpected token )"),
        ("(" * 5000, f"column {MAX_DEPTH // 2 + 1}: nested more than {MAX_DEPTH} deep"),
        ("{p} " * 9000, "column 20001: longer than 20000 characters"),
    ],
)
def test_a_fault_is_named_with_its_column(source, message):
    with pytest.raises(FormulaError) as raised:
        parse_formula(source)
    assert str(raised.value) == message


WORDS = [
    "historically",
    "once",
    "since",
    "not",
    "and",
    "or",
    "->",
    "{p}",
    "{x > 3}",
    "(",
    ")",
    "[1:2]",
    "[",
    ":",
    "{",
    "}",
    "true",
    "!",
    "{a: 'b'}",
    " ",
    "H",
    "9",
]


@given(st.lists(st.sampled_from(WORDS), max_size=60).map("".join) | st.text(max_size=80))
@example("{" * 3000)
@example("not " * 4000 + "{p}")
@example("{p} -> " * 2000 + "{p}")
@example("{p} and " * 2000 + "{p}")
@example("{" + "!" * 3000 + "p}")
@example("{a" + "[0]" * 1000 + "}")
@example("{a" + "?a:a" * 60 + "}")
@example("{\\u0061}")
@example("{'\\ud800'}")
@settings(max_examples=300, deadline=None)
def test_no_input_crashes_or_hangs_the_reader(source):
    try:
        formula = parse_formula(source)
        network_code(build_network([formula])).program().step(0)
        PropertyMonitor(formula)
    except (FormulaError, PredicateError):
        return


def test_equal_predicates_are_one_atom_wherever_they_stand():
    network = build_network(
        [parse_formula("{x>3} and once{ x > 3 }"), parse_formula("not {x > 3.0}")]
    )
    assert network.atoms == ("x > 3",)


def test_dual_formulas_share_their_nodes():
    network = build_network(
        [
            parse_formula("historically {p}"),
            parse_formula("once not {p}"),
            parse_formula("not historically {p}"),
        ]
    )
    assert sum(node.kind == "once" for node in network.nodes) == 1


@pytest.mark.parametrize(
    ("source", "seconds"),
    [
        ("historically(not((not {alarm}) since[5:] {low}))", 5),
        ("historically(({alarm} -> once{low}) and not((not {alarm}) since[5:] {low}))", 5),
        ("historically({alarm} -> once[:5]{low})", None),
        ("historically(({alarm} and {low}) -> once[:5]{low})", None),
        ("historically({high} -> once[:5]{low})", 5),
        ("historically((once[3:] true) -> once[:3]{alarm})", 3),
        ("historically(not {alarm})", None),
        ("once[:2]({low} or historically[:7]{low})", 2),
        ("not historically[1:4]{low}", 4),
        ("{low} since[2:9] {high}", 9),
        ("not ({low} since[2:9] {high})", 2),
    ],
)
def test_a_deadline_is_what_waiting_alone_can_miss(source, seconds):
    expected = None if seconds is None else seconds * TICKS_PER_SECOND
    assert formula_deadline(parse_formula(source), {"alarm"}) == expected
