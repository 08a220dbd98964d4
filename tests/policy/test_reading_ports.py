"""What a plugin reads from its ports: inputs, its own outputs, names of channels, rates of timers."""

from __future__ import annotations

from pathlib import Path

import pytest

from m2c.codegen.package import system_files
from m2c.codegen.writer import write_files
from tests.codegen.quality import formatted, strictly_typed
from tests.policy.simulated import HEAD, checked, simulated, statuses, written

COUNT = (
    HEAD.format("Count", "wait")
    + """
<bt_declare_port_out key="n" type="int32"/>
<datamodel><data id="n" type="int32" expr="0"/></datamodel>
<state id="wait"><bt_tick target="wait">
  <assign location="n"><expr><bt_get_input key="n"/></expr></assign>
  <bt_set_output key="n" expr="n + 1"/>
  <bt_return_status status="SUCCESS"/>
</bt_tick></state></scxml>"""
)
BEGUN = COUNT.replace(
    '<state id="wait">',
    '<state id="begin"><transition target="wait"><bt_set_output key="n" expr="5"/></transition></state>'
    '<state id="wait">',
).replace('initial="wait"', 'initial="begin"')
IS = '<ScriptCondition code="n == {}"/>'


def test_an_output_port_is_read_as_zero_until_something_sets_its_entry(tmp_path: Path) -> None:
    tree = f'<Sequence><Count n="{{n}}"/>{IS.format(2)}</Sequence>'
    run = simulated(written(tmp_path, tree, {"Count": COUNT}), 3.0)
    assert statuses(run) == ["FAILURE", "SUCCESS", "FAILURE"]


def test_what_a_plugin_set_before_its_first_tick_it_reads_at_that_tick(tmp_path: Path) -> None:
    tree = f'<Sequence><Count n="{{n}}"/>{IS.format(6)}</Sequence>'
    assert statuses(simulated(written(tmp_path, tree, {"Count": BEGUN}), 1.0)) == ["SUCCESS"]


def test_a_plugin_reads_from_its_output_port_what_another_node_wrote(tmp_path: Path) -> None:
    tree = f'<Sequence><Script code="n := 40"/><Count n="{{n}}"/>{IS.format(41)}</Sequence>'
    run = simulated(written(tmp_path, tree, {"Count": COUNT}), 2.0)
    assert statuses(run) == ["SUCCESS", "SUCCESS"]


def test_a_plugin_reads_what_it_set_between_two_ticks(tmp_path: Path) -> None:
    plugin = COUNT.replace(
        '<state id="wait">',
        '<ros_time_rate name="clock" rate_hz="4"/><state id="wait"><ros_rate_callback name="clock">'
        '<bt_set_output key="n" expr="100"/></ros_rate_callback>',
    )
    tree = f'<Sequence><Count n="{{n}}"/>{IS.format(101)}</Sequence>'
    run = simulated(written(tmp_path, tree, {"Count": plugin}), 3.0)
    assert statuses(run) == ["FAILURE", "SUCCESS", "SUCCESS"]


def test_reading_an_output_port_is_said_with_its_place(tmp_path: Path) -> None:
    _, said = checked(written(tmp_path, '<Count n="{n}"/>', {"Count": COUNT}))
    assert said == [
        "Count.scxml: warning: <bt_get_input>: `n` is an output port, which BehaviorTree.CPP does not let a "
        "node read; its blackboard entry is read; zero or empty until something sets it [output-read]"
    ]


def test_a_port_that_is_both_input_and_output_is_read_without_a_word(tmp_path: Path) -> None:
    plugin = COUNT.replace(
        "<datamodel>", '<bt_declare_port_in key="n" type="int32"/><datamodel>', 1
    )
    tree = f'<Sequence><Script code="n := 1"/><Count n="{{n}}"/>{IS.format(2)}</Sequence>'
    system = written(tmp_path, tree, {"Count": plugin})
    assert checked(system)[1] == []
    assert statuses(simulated(system, 1.0)) == ["SUCCESS"]


def test_a_port_that_is_not_declared_is_refused(tmp_path: Path) -> None:
    text = COUNT.replace('<bt_get_input key="n"/>', '<bt_get_input key="m"/>')
    _, said = checked(written(tmp_path, '<Count n="{n}"/>', {"Count": text}))
    assert said == [
        "Count.scxml: error: <assign>: port `m` is not declared; known: n [undeclared-port]"
    ]


BEATS = (
    HEAD.format("Beats", "wait")
    + """
<bt_declare_port_in key="rate" type="{}"/>
<ros_time_rate name="clock"><rate_hz><bt_get_input key="rate"/></rate_hz></ros_time_rate>
<datamodel><data id="n" type="int32" expr="0"/></datamodel>
<state id="wait">
  <ros_rate_callback name="clock"><assign location="n" expr="n + 1"/></ros_rate_callback>
  <bt_tick cond="n == 9"><bt_return_status status="SUCCESS"/></bt_tick>
  <bt_tick><bt_return_status status="FAILURE"/></bt_tick>
</state></scxml>"""
)


@pytest.mark.parametrize("kind", ["float64", "int8"])
def test_a_timer_has_the_rate_that_its_port_is_given(kind: str, tmp_path: Path) -> None:
    tree = '<Sequence><Beats rate="3"/></Sequence>'
    run = simulated(written(tmp_path, tree, {"Beats": BEATS.format(kind)}), 4.5)
    assert statuses(run) == ["FAILURE", "FAILURE", "FAILURE", "SUCCESS", "FAILURE"]


def test_a_rate_may_be_written_as_an_element(tmp_path: Path) -> None:
    text = BEATS.format("float64").replace('<bt_get_input key="rate"/>', " 3.0 ")
    run = simulated(written(tmp_path, '<Beats rate="1"/>', {"Beats": text}), 4.5)
    assert statuses(run) == ["FAILURE", "FAILURE", "FAILURE", "SUCCESS", "FAILURE"]


@pytest.mark.parametrize(
    ("rate", "said"),
    [
        ("0", "`rate` is `0`; `Beats` takes a timer's rate from it: a number greater than 0"),
        ("inf", "`rate` is `inf`; `Beats` takes a timer's rate from it: a number greater than 0"),
        ("fast", "`rate` is `fast`; the port has type float64"),
        (
            "{r}",
            "`rate` is the blackboard entry `{r}`; `Beats` takes a timer's rate from it: write it out",
        ),
    ],
)
def test_what_is_no_rate_is_refused_where_the_policy_gives_it(
    rate: str, said: str, tmp_path: Path
) -> None:
    system = written(tmp_path, f'<Beats rate="{rate}"/>', {"Beats": BEATS.format("float64")})
    assert checked(system)[1] == [f"policy.xml: error: <Beats>: {said} [leaf-port]"]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            BEATS.format("string"),
            "the rate of `clock` is the value of port `rate`; it has type string; a rate is a number "
            "[type-mismatch]",
        ),
        (
            BEATS.format("float64").replace(
                '<bt_get_input key="rate"/>', '<bt_get_input key="r"/>'
            ),
            "port `r` is not declared; known: rate [undeclared-port]",
        ),
        (
            BEATS.format("float64").replace('<bt_get_input key="rate"/>', "-1"),
            "<ros_time_rate>: `-1` is not a rate; rate_hz is a number of callbacks a second, greater than 0 "
            "[bad-rate]",
        ),
    ],
)
def test_what_is_no_rate_is_refused_where_the_model_gives_it(
    text: str, said: str, tmp_path: Path
) -> None:
    _, found = checked(written(tmp_path, '<Beats rate="3"/>', {"Beats": text}))
    assert found == [f"Beats.scxml: error: {said}"]


TELL = (
    HEAD.format("Tell", "wait")
    + """
<bt_declare_port_in key="to" type="string"/>
<ros_topic_publisher name="out" type="std_msgs/Int32"><topic><bt_get_input key="to"/></topic></ros_topic_publisher>
<state id="wait"><bt_tick target="wait">
  <ros_topic_publish name="out"><field name="data" expr="7"/></ros_topic_publish>
  <bt_return_status status="SUCCESS"/>
</bt_tick></state></scxml>"""
)
LISTENER = (
    HEAD.format("Listener", "wait")
    + """
<ros_topic_subscriber topic="/said" type="std_msgs/Int32"/>
<state id="wait"><ros_topic_callback name="said" cond="_msg.data == 7" target="told"/></state>
<state id="told"/></scxml>"""
)


@pytest.mark.parametrize("to", ["/said", "said"])
def test_a_channel_from_a_port_may_be_written_without_its_first_slash(
    to: str, tmp_path: Path
) -> None:
    system = written(tmp_path, f'<Tell to="{to}"/>', {"Tell": TELL}, {"Listener": LISTENER})
    assert checked(system)[1] == []
    assert simulated(system, 1.5).nodes["Listener"].machine.state.value == "told"


def test_what_is_generated_of_such_plugins_is_formatted_and_strictly_typed(tmp_path: Path) -> None:
    tree = '<Sequence><Count n="{n}"/><Beats rate="3"/><Tell to="said"/></Sequence>'
    plugins = {
        "Count": COUNT.replace('status="SUCCESS"', 'status="n"'),
        "Beats": BEATS.format("int8"),
        "Tell": TELL,
    }
    system, said = checked(written(tmp_path, tree, plugins))
    assert system is not None, said
    output = tmp_path / "generated"
    write_files(system_files(system), output)
    (package,) = output.glob("*_policy")
    formatted(output)
    strictly_typed(output, [package])
