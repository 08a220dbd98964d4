"""``rises`` and ``falls``: when something becomes true or false, in formulas, YAML and XML."""

from __future__ import annotations

import pytest

from m2c.diagnostics import DiagnosticLog
from moon.properties.describe import formula_deadline
from moon.properties.files.xml import parse_property_xml
from moon.properties.files.yaml import parse_property_yaml
from moon.properties.formula import Not, Rise, text
from moon.properties.monitor import PropertyMonitor
from moon.properties.property import Port, Property, Status
from moon.properties.syntax import FormulaError, parse_formula
from tests.properties.runs import run, seen

FILE = """\
ports:
  level: {topic: /level, field: data}
  docked: {topic: /docked}
predicates:
  low: level < 1.5
  emptied: {rises: low}
properties:
"""
WANTED = "historically (not ((not {docked}) since[5:] ((not {docked}) and (rises {level < 1.5}))))"


def read(entry: str) -> tuple[list[Property], list[str]]:
    log = DiagnosticLog()
    found = parse_property_yaml(f"{FILE}  - {{id: P, {entry}}}\n".encode(), "p.yaml", log)
    return found, [str(item) for item in log.diagnostics]


def monitor(source: str, **port) -> PropertyMonitor:
    ports = (Port("p", "/p", path=("v",), **port),)
    return PropertyMonitor(Property("f", parse_formula(source, ticks_per_unit=1), ports))


@pytest.mark.parametrize("source", ["rises {p}", "falls {p}", "rises (once[:5] {p})"])
def test_what_is_written_is_what_is_read(source):
    assert text(parse_formula(source)) == source
    assert text(parse_formula(f"historically ({source})")) == f"historically ({source})"
    assert (
        parse_formula("rises not {p}")
        == parse_formula("falls {p}")
        == Rise(Not(parse_formula("{p}")))
    )


def test_it_is_so_at_the_instant_at_which_the_value_changes_and_not_afterwards():
    trace = [{"p": bool(value)} for value in (0, 1, 1, 0, 0, 1, 0)]
    rises = [verdict.status is Status.TRUE for verdict in run(parse_formula("rises {p}"), trace)]
    falls = [verdict.status is Status.TRUE for verdict in run(parse_formula("falls {p}"), trace)]
    assert rises == [False, True, False, False, False, True, False]
    assert falls == [False, False, False, True, False, False, True]


def test_the_first_observation_is_no_rise_unless_it_is_said_what_was_before():
    it = monitor("not rises {p}")
    assert it.observe(seen(5, "/p", v=True)).status is Status.TRUE
    it = monitor("not rises {p}", initial=False)
    it.advance(3)
    assert it.observe(seen(5, "/p", v=True)).status is Status.FALSE
    assert it.advance(6).status is Status.TRUE
    it = monitor("not falls {p}", initial=False)
    assert it.advance(3).status is Status.TRUE


def test_after_a_loss_whether_it_rose_is_unknown_and_is_known_again_at_the_next_change():
    it = monitor("not rises {p}")
    it.observe(seen(0, "/p", v=False))
    it.lose("/p", 3, 6)
    assert it.advance(2).status is Status.TRUE
    assert it.observe(seen(8, "/p", v=True)).status is Status.INCONCLUSIVE
    assert it.advance(9).status is Status.TRUE
    it.observe(seen(10, "/p", v=False))
    assert it.observe(seen(11, "/p", v=True)).status is Status.FALSE


def test_what_is_false_and_true_again_at_one_instant_has_risen_just_after():
    it = monitor("not rises {p}")
    it.observe(seen(0, "/p", v=True))
    it.observe(seen(5, "/p", v=False))
    assert it.observe(seen(5, "/p", v=True)).status is Status.TRUE
    assert it.advance(6).status is Status.FALSE


@pytest.mark.parametrize(
    "asked",
    ["{rises: level < 1.5}", '{rises: "level < 1.5"}', "{rises: low}", "emptied"],
)
def test_a_role_takes_it_as_a_map_and_so_does_a_named_predicate(asked):
    (item,), said = read(f"pattern: response, request: {asked}, response: docked, within: 5 s")
    assert said == []
    assert text(item.formula) == WANTED
    assert item.meaning == "Always, every rise of `level < 1.5` is followed by `docked` within 5 s."
    assert item.deadline_ticks == 5 * 10**9


def test_so_do_lists_and_scopes():
    (item,), said = read(
        "pattern: response_chain, request: docked, responses: [{rises: low}, {falls: low}], "
        "between: [emptied, {falls: low}]"
    )
    assert said == []
    assert "falls {level < 1.5}" in text(item.formula)


def test_moons_xml_takes_it_as_an_attribute():
    source = """\
<properties>
  <ports>
    <ros_topic topic_name="/level"><state_var id="level" field="data"/></ros_topic>
    <ros_topic topic_name="/docked"><event_var id="docked"/></ros_topic>
  </ports>
  <guarantees>
    <property id="P" pattern="response">
      <events><event edge="rises">level &lt; 1.5</event><event>docked</event></events>
      <time_interval within="5" time_unit="s"/>
    </property>
    <property id="Q" pattern="absence"><event edge="up">docked</event></property>
  </guarantees>
</properties>
"""
    log = DiagnosticLog()
    (item,) = parse_property_xml(source.encode(), "p.xml", log)
    assert text(item.formula) == WANTED
    (said,) = map(str, log.diagnostics)
    assert said.startswith('p.xml:11:53: error: <event>: edge="up" is neither rises nor falls')


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ("{rise: low}", "`rise` means nothing here; did you mean `rises`?"),
        ("{}", "`of` needs one of `rises` and `falls`"),
        ("{rises: low, falls: low}", "`of` needs one of `rises` and `falls`"),
        ("{rises: [low]}", "`of` is one expression"),
        ("{rises: emptied}", "`rises` of what holds for an instant only"),
        ("rises(low)", "a condition that becomes true is written {rises: x > 1}"),
    ],
)
def test_what_is_written_otherwise_is_one_error_with_a_hint(asked, message):
    found, said = read(f"pattern: absence, of: {asked}")
    assert found == []
    assert len(said) == 1
    assert message in said[0]
    assert said[0].startswith("p.yaml:8:")


def test_one_inside_another_is_refused_in_a_formula():
    with pytest.raises(FormulaError, match="`rises` of what holds for an instant only") as caught:
        parse_formula("once rises (not falls {p})")
    assert caught.value.offset == 5


def test_waiting_alone_makes_nothing_rise():
    assert formula_deadline(parse_formula("historically(rises {p} -> once[:5] {q})")) is None
    assert formula_deadline(parse_formula("not rises (historically[3:7] {p})")) == 7 * 10**9
