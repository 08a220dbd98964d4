"""The oracle of a lenient model: what its node sends is no alarm, what ECMAScript does not say is one."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import m2c
import moon
from m2c.model import Machine
from m2c.model.machine import EventKind
from moon.oracle.program import MachineProgram
from moon.oracle.unknowns import Unknown, anything
from tests.codegen.harness import Generated
from tests.oracle.machines import library, read
from transports import SimulatedWorld, Topic

HEAD = '<scxml xmlns="http://www.w3.org/2005/07/scxml" datamodel="ecmascript" name="Probe" initial="a">'
PORTS = (
    '<ros_topic_subscriber topic="/in" type="std_msgs/String"/>'
    '<ros_topic_publisher topic="/out" type="std_msgs/Int32"/>'
    '<ros_topic_publisher topic="/text" type="std_msgs/String"/>'
)
DATA = (
    '<data id="n" type="int16" expr="\'7\'"/><data id="s" type="string" expr="1.5"/>'
    '<data id="b" type="bool" expr="0"/><data id="f" type="float64" expr="\'0.5\'"/>'
    '<data id="u" expr="[]"/>'
)


def publish(name: str, text: str) -> str:
    return (
        f'<ros_topic_publish name="{name}"><field name="data" expr="{text}"/></ros_topic_publish>'
    )


def machine(body: str) -> Machine:
    return read(
        f"{HEAD}{PORTS}<datamodel>{DATA}</datamodel><state id='a'>"
        f"<ros_topic_callback name='/in'>{body}</ros_topic_callback></state></scxml>"
    ).made_lenient()


def sent(model: Machine, message: str = "", **data: Any) -> set[tuple[str, ...]]:
    """What the machine may publish on taking ``message``, if variables have the values in ``data``."""
    program = MachineProgram(model, library())
    start = dict(zip(program.names, program.initial_data(), strict=True)) | data
    unknown = any(isinstance(item, Unknown) for item in start.values())
    steps = program.take(
        0, tuple(start.values()), (EventKind.MESSAGE, "/in"), {"data": message}, {}, unknown
    )
    return {tuple(repr(output.fields["data"]) for output in step.outputs) for _, step in steps}


def test_values_become_what_ecmascript_says() -> None:
    assert sent(machine(publish("/out", "n") + publish("/text", "s"))) == {("7", "'1.5'")}
    body = '<assign location="n" expr="_msg.data"/><assign location="b" expr="_msg.data"/>'
    model = machine(f"{body}{publish('/out', 'n')}{publish('/text', 'b')}")
    assert sent(model, " 65537.9 ") == {("1", "'true'")}
    assert sent(model, "x") == {("0", "'true'")}
    assert sent(model, "") == {("0", "'false'")}


def test_what_is_missing_ends_the_block() -> None:
    model = machine(f'<assign location="n" expr="u[0]"/>{publish("/out", "n")}')
    assert sent(model) == {()}
    assert sent(model, u=anything()) == {(), ("-32768…32767",)}


def test_an_unknown_number_is_truncated_and_its_text_is_unknown() -> None:
    model = machine(f'<assign location="n" expr="f"/>{publish("/out", "n")}{publish("/text", "f")}')
    assert sent(model, f=Unknown(-1.5, 2.5)) == {("-1…2", "?")}


def test_a_number_that_is_not_known_may_be_what_a_text_says() -> None:
    model = machine(f'<if cond="n == _msg.data">{publish("/out", "n")}</if>')
    assert sent(model, "3", n=Unknown(0, 9, integer=True)) == {(), ("3",)}
    assert sent(model, "30", n=Unknown(0, 9, integer=True)) == {()}
    assert sent(model, "x", n=Unknown(0, 9, integer=True)) == {()}


def test_a_text_that_equals_a_number_is_not_taken_for_that_number() -> None:
    model = machine(f'<if cond="s == 3">{publish("/text", "s")}</if>')
    assert sent(model, s=anything()) == {(), ("?",)}
    number = machine(f"<if cond='n == 3'>{publish('/out', 'n')}</if>")
    assert sent(number, n=anything()) == {(), ("3",)}
    known = machine(f"<if cond=\"s == '3'\">{publish('/text', 's')}</if>")
    assert sent(known, s=anything()) == {(), ("'3'",)}


TERMS = st.sampled_from(
    ["n", "s", "b", "f", "_msg.data", "u", "u[0]", "'12'", "' '", "true", "2.75", "300"]
)
EXPRESSIONS = st.recursive(
    TERMS,
    lambda inner: st.one_of(
        st.tuples(inner, st.sampled_from(["+", "-", "*", "==", "!=", "&lt;", "||"]), inner).map(
            lambda t: f"({t[0]} {t[1]} {t[2]})"
        ),
        st.tuples(inner, inner, inner).map(lambda t: f"({t[0]} ? {t[1]} : {t[2]})"),
        inner.map(lambda item: f"Math.floor({item})"),
        inner.map(lambda item: f"-({item})"),
    ),
    max_leaves=4,
)


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> pytest.TempPathFactory:
    return tmp_path_factory


@settings(max_examples=40, deadline=None)
@given(
    assigns=st.lists(st.tuples(st.sampled_from("nsbf"), EXPRESSIONS), min_size=1, max_size=3),
    message=st.sampled_from(["", "3", "-2.5", "70000", "x", "true", "0x10", "Infinity"]),
)
def test_node_and_oracle_compute_the_same(
    folders: pytest.TempPathFactory, assigns: list[tuple[str, str]], message: str
) -> None:
    body = "".join(f'<assign location="{name}" expr="{text}"/>' for name, text in assigns)
    body += publish("/out", "n") + publish("/text", "s + '|' + b + '|' + f")
    text = (
        f"{HEAD}{PORTS}<datamodel>{DATA}</datamodel><state id='a'>"
        f"<ros_topic_callback name='/in'>{body}</ros_topic_callback></state></scxml>"
    )
    probe = Generated(folders.mktemp("probe"), text, lenient=True)
    probe.it.on_in__message(probe.interfaces.String(data=message))
    published = tuple(repr(item[1].data) for item in probe.outputs.sent if item[0] != "fault")
    assert sent(machine(body), message) == {published}


# -- a whole system, in virtual time -----------------------------------------------------------------

SOURCE = """<scxml xmlns="http://www.w3.org/2005/07/scxml" name="Source" initial="a">
<ros_time_rate rate_hz="10" name="tick"/><ros_topic_publisher topic="/level" type="std_msgs/String"/>
<datamodel><data id="charge" type="float64" expr="'50.5'"/></datamodel>
<state id="a"><ros_rate_callback name="tick">
  <assign location="charge" expr="charge &lt; 20 ? 50.5 : charge - 3.25"/>
  <ros_topic_publish name="/level"><field name="data" expr="{level}"/></ros_topic_publish>
</ros_rate_callback></state></scxml>"""
GAUGE = """<scxml xmlns="http://www.w3.org/2005/07/scxml" name="Gauge" initial="high">
<ros_topic_subscriber topic="/level" type="std_msgs/String"/>
<ros_topic_publisher topic="/percent" type="std_msgs/Int32"/>
<ros_topic_publisher topic="/alarm" type="std_msgs/Bool"/>
<datamodel><data id="last" type="int32" expr="0"/><data id="seen" type="string" expr="0"/></datamodel>
<state id="high"><ros_topic_callback name="/level" cond="_msg.data &lt; 30" target="low">{body}</ros_topic_callback>
<ros_topic_callback name="/level">{body}</ros_topic_callback></state>
<state id="low"><onentry><ros_topic_publish name="/alarm"><field name="data" expr="last"/></ros_topic_publish></onentry>
<ros_topic_callback name="/level" cond="!(_msg.data &lt; 30)" target="high">{body}</ros_topic_callback>
<ros_topic_callback name="/level">{body}</ros_topic_callback></state></scxml>"""
BODY = """<assign location="last" expr="_msg.data"/><assign location="seen" expr="last + seen.length"/>
<ros_topic_publish name="/percent"><field name="data" expr="{percent}"/></ros_topic_publish>"""
PERCENT = "last == seen ? 'none' : _msg.data * '1'"


def system(folder: Path, level: str = "charge", percent: str = PERCENT) -> m2c.System:
    folder.mkdir()
    (folder / "source.scxml").write_text(SOURCE.format(level=level))
    (folder / "gauge.scxml").write_text(GAUGE.format(body=BODY.format(percent=percent)))
    return m2c.read_system(folder, lenient=True)


def verdicts(model: m2c.System, node: m2c.System, join_s: float = 0.0) -> list[moon.Verdict]:
    """What is said of ``node``, run for some seconds, by a monitor of ``model``."""
    world = SimulatedWorld(seed=1)
    said: list[moon.Verdict] = []
    monitor = moon.Monitor(world.connect("monitor"), model, on_verdict=said.append)
    if not join_s:
        monitor.start()
        world.run_for(0.01)
    run = m2c.simulate(node, world)
    if join_s:
        run.run(join_s)
        monitor.start()
    run.run(8.0)
    assert "conforming" in {status.verdict for status in monitor.statuses()}
    return said


@pytest.mark.parametrize("join_s", [0.0, 1.23])
def test_a_node_that_converts_as_ecmascript_does_raises_no_alarm(
    tmp_path: Path, join_s: float
) -> None:
    model = system(tmp_path / "model")
    assert {found.rule for found in m2c.check(model)} == {"lenient-conversion"}
    assert not [item for item in verdicts(model, model, join_s) if item.outcome == "violated"]


@pytest.mark.parametrize("percent", ["Math.round(_msg.data)", "_msg.data + '0'", "'none'"])
def test_a_node_that_converts_otherwise_is_found(tmp_path: Path, percent: str) -> None:
    model = system(tmp_path / "model")
    node = system(tmp_path / "node", percent=percent)
    wrong = [item for item in verdicts(model, node) if item.outcome == "violated"]
    assert {item.node for item in wrong} == {"Gauge"}
    assert "/percent" in wrong[0].reason


def test_the_same_system_is_refused_where_nobody_asked_for_it(tmp_path: Path) -> None:
    model = system(tmp_path / "model")
    strict = m2c.read_system(model.path)
    assert any(found.severity == "error" for found in m2c.check(strict))
    with pytest.raises(m2c.ModelError, match="type-mismatch"):
        m2c.simulate(strict, SimulatedWorld(seed=1))


class Text(msgspec.Struct):
    data: str = ""

    __type_name__ = "std_msgs/msg/String"


def test_a_text_from_elsewhere_that_is_no_number_is_zero_to_node_and_oracle(tmp_path: Path) -> None:
    model = system(tmp_path / "model")
    world = SimulatedWorld(seed=1)
    said: list[moon.Verdict] = []
    monitor = moon.Monitor(world.connect("monitor"), model, on_verdict=said.append)
    monitor.start()
    world.run_for(0.01)
    gauge = msgspec.structs.replace(model, nodes=tuple(n for n in model.nodes if n.name == "Gauge"))
    run = m2c.simulate(gauge, world)
    source = world.connect("Elsewhere")
    level = source.publisher(Topic("/level", Text.__type_name__, Text))
    source.announce()
    for text in ("12.9", "much", "", "1e3", "Infinity"):
        source.post(lambda text=text: level.publish(Text(text)))
        run.run(0.5)
    assert not [item for item in said if item.outcome == "violated"]
    gauges = [status for status in monitor.statuses() if status.machine == "Gauge"]
    assert [status.verdict for status in gauges] == ["conforming"]
