"""The meaning that AS2FM gives to models, ``--semantics as2fm``: steps, messages, events that wait, the end."""

from __future__ import annotations

from pathlib import Path

import pytest

from m2c.check.reading import read_and_check
from m2c.model import DiagnosticLog
from m2c.simulation.program import compile_system
from m2c.simulation.run import SimulatedRun
from m2c.simulation.semantics import Semantics
from transports.interface import Observation, ObservationKind
from transports.simulated.world import START_NS

MACHINE = """<ascxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" name="{name}" initial="a">
<datamodel><data id="n" type="int32" expr="0"/></datamodel>{body}</ascxml>"""
COUNTER = """<ros_topic_publisher topic="/{name}" type="std_msgs/Int32"/>
<state id="a"><transition target="a"{condition}><assign location="n" expr="n + 1"/>
<ros_topic_publish name="/{name}"><field name="data" expr="n"/></ros_topic_publish></transition></state>"""
ECHO = """<ros_topic_subscriber topic="/{heard}" type="std_msgs/Int32"/>
<ros_topic_publisher topic="/echo" type="std_msgs/Int32"/>
<state id="a"><ros_topic_callback name="/{heard}" target="{next}"><assign location="n" expr="_msg.data"/>
</ros_topic_callback></state>
<state id="said"><transition target="a"><ros_topic_publish name="/echo"><field name="data" expr="n"/>
</ros_topic_publish></transition></state>"""
CLOCK = """<ros_topic_publisher topic="/{topic}" type="std_msgs/Int32"/><ros_time_rate name="t" rate_hz="1"/>
<state id="a"><ros_rate_callback name="t" target="a"><assign location="n" expr="n + 1"/>
<ros_topic_publish name="/{topic}"><field name="data" expr="n"/></ros_topic_publish></ros_rate_callback></state>"""
SERVER = """<ros_service_server service_name="/s" type="std_srvs/SetBool"/><ros_time_rate name="t" rate_hz="1"/>
<state id="a"><ros_rate_callback name="t" target="ready"/></state>
<state id="ready"><ros_service_handle_request name="/s" target="ready"><ros_service_send_response name="/s">
<field name="success" expr="_req.data"/></ros_service_send_response></ros_service_handle_request></state>"""
CLIENT = """<ros_service_client service_name="/s" type="std_srvs/SetBool"/>
<ros_topic_publisher topic="/{name}" type="std_msgs/Bool"/>
<state id="a"><transition target="asked"><ros_service_send_request name="/s"><field name="data" expr="{data}"/>
</ros_service_send_request></transition></state>
<state id="asked"><ros_service_handle_response name="/s" target="answered"><ros_topic_publish name="/{name}">
<field name="data" expr="_res.success"/></ros_topic_publish></ros_service_handle_response></state>
<state id="answered"/>"""
GOALS = """<ros_action_server name="s" action_name="/s" type="example_interfaces/Fibonacci"/>
<ros_time_rate name="t" rate_hz="1"/>
<state id="a"><ros_rate_callback name="t" target="ready"/></state>
<state id="ready"><ros_action_handle_goal name="s" target="ready"><assign location="n" expr="_action.goal_id"/>
<ros_action_accept_goal name="s" goal_id="n"/><ros_action_succeed name="s" goal_id="n">
<field name="sequence" expr="[_goal.order]"/></ros_action_succeed></ros_action_handle_goal></state>"""
HASTY = """<ros_action_client name="c" action_name="/s" type="example_interfaces/Fibonacci"/>
<ros_topic_publisher topic="/done" type="std_msgs/Int32"/><ros_time_rate name="t" rate_hz="1"/>
<state id="a"><transition target="asked"><ros_action_send_goal name="c"><field name="order" expr="7"/>
</ros_action_send_goal></transition></state>
<state id="asked"><ros_action_handle_goal_response name="c" accept="late" reject="lost"/></state>
<state id="late"><ros_rate_callback name="t" cond="n == 1" target="ready"/>
<ros_rate_callback name="t" target="late"><assign location="n" expr="n + 1"/></ros_rate_callback></state>
<state id="ready"><ros_action_handle_success_result name="c" target="lost"><ros_topic_publish name="/done">
<field name="data" expr="_wrapped_result.result.sequence[0]"/></ros_topic_publish>
</ros_action_handle_success_result></state><state id="lost"/>"""
LEAF = """<ros_topic_subscriber topic="/clock_topic" type="std_msgs/Int32"/>
<state id="a"><ros_topic_callback name="/clock_topic" target="ready"/></state>
<state id="ready"><bt_tick target="ready"><bt_return_status status="SUCCESS"/></bt_tick></state>"""
DONE = (
    """<state id="a"><bt_tick target="a"><bt_return_status status="SUCCESS"/></bt_tick></state>"""
)
TREE = '<root BTCPP_format="4"><BehaviorTree ID="Tree"><Action ID="Leaf"/></BehaviorTree></root>'


def seen(
    folder: Path,
    models: dict[str, str],
    seconds: float = 1.0,
    semantics: Semantics = Semantics.AS2FM,
    leaf: str = "",
    parameters: str = "",
    most: int = 20,
) -> list[tuple[float, str, object]]:
    """What nodes publish in a run that is ended by so many messages: when, on which topic, and what.

    Args:
        folder: where the models are written.
        models: the bodies of machines by their names.
        seconds: how long to run.
        semantics: what the models mean.
        leaf: the body of the plugin that the only leaf of the tree is; none: there is no tree.
        parameters: of the system.
        most: messages.
    """
    for name, body in {**models, **({"Leaf": leaf} if leaf else {})}.items():
        (folder / f"{name}.ascxml").write_text(MACHINE.format(name=name, body=body))
    inputs = "".join(f'<input type="node-ascxml" src="{name}.ascxml"/>' for name in models)
    tree = ""
    if leaf:
        (folder / "bt.xml").write_text(TREE)
        tree = (
            '<behavior_tree><input type="bt.cpp-xml" src="bt.xml"/>'
            '<input type="bt-plugin-ascxml" src="Leaf.ascxml"/></behavior_tree>'
        )
    (folder / "main.xml").write_text(
        f"<roaml><parameters>{parameters}</parameters>{tree}<node_models>{inputs}</node_models></roaml>"
    )
    log = DiagnosticLog()
    system = read_and_check([folder / "main.xml"], [], log)
    assert system is not None
    assert not log.has_errors, log.diagnostics
    found: list[tuple[float, str, object]] = []

    def observe(event: Observation) -> None:
        if event.kind is ObservationKind.MESSAGE and "_action" not in event.channel:
            assert isinstance(event.data, dict)
            value = event.data["data"] if "data" in event.data else event.data["status"]
            at = round((event.stamp_ns - START_NS) / 1e9, 3)
            found.append((at, event.channel, value))

    world = semantics.world(seed=1)
    world.connect("observer").tap([], observe)
    running = SimulatedRun(
        compile_system(system, semantics), world, semantics.settings(seconds), tick_timeout_s=60.0
    )
    running.run(seconds, lambda: len(found) >= most)
    world.close()
    return found


def values(found: list[tuple[float, str, object]]) -> list[tuple[str, object]]:
    return [(topic, value) for _, topic, value in found]


def counter(name: str, condition: str = "") -> str:
    return COUNTER.format(name=name, condition=condition)


# --- steps ----------------------------------------------------------------------------------------


def test_machines_take_their_eventless_transitions_in_turn(tmp_path: Path) -> None:
    found = seen(tmp_path, {"A": counter("a"), "B": counter("b")}, most=6)
    turns = [("/a", 1), ("/b", 1), ("/a", 2), ("/b", 2), ("/a", 3), ("/b", 3)]
    assert values(found)[:6] == turns


def test_a_chain_without_end_takes_no_time_and_is_no_error(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    found = seen(tmp_path, {"A": counter("a")}, most=5000)
    assert (found[0], found[4999]) == ((0.0, "/a", 1), (0.0, "/a", 5000))
    assert not caplog.records


def test_deployed_a_chain_is_one_macrostep(tmp_path: Path) -> None:
    ends = ' cond="n &lt; 2"'
    found = seen(
        tmp_path, {"A": counter("a", ends), "B": counter("b", ends)}, semantics=Semantics.DEPLOYED
    )
    assert values(found) == [("/a", 1), ("/a", 2), ("/b", 1), ("/b", 2)]


# --- messages and time ----------------------------------------------------------------------------


def test_a_message_is_received_before_the_next_step(tmp_path: Path) -> None:
    heard = """<ros_topic_subscriber topic="/a" type="std_msgs/Int32"/>
    <ros_topic_publisher topic="/echo" type="std_msgs/Int32"/>
    <state id="a"><ros_topic_callback name="/a" target="a"><ros_topic_publish name="/echo">
    <field name="data" expr="_msg.data"/></ros_topic_publish></ros_topic_callback></state>"""
    found = seen(tmp_path, {"A": counter("a"), "B": counter("b"), "Echo": heard}, most=6)
    assert values(found)[:6] == [
        *(("/a", 1), ("/echo", 1), ("/b", 1)),
        *(("/a", 2), ("/echo", 2), ("/b", 2)),
    ]


def test_a_timer_fires_only_when_nothing_else_is_due(tmp_path: Path) -> None:
    models = {
        "A": CLOCK.format(topic="a"),
        "B": CLOCK.format(topic="b"),
        "Echo": ECHO.format(heard="a", next="said"),
    }
    assert seen(tmp_path, models) == [(1.0, "/a", 1), (1.0, "/echo", 1), (1.0, "/b", 1)]


def test_the_tree_is_ticked_first_after_one_period(tmp_path: Path) -> None:
    going = '<bt_tick_rate value="2"/><bt_tick_if_not_running value="true"/>'
    found = seen(tmp_path, {}, leaf=DONE, parameters=going)
    assert [at for at, *_ in found] == [0.5, 1.0]


# --- events that nobody takes ---------------------------------------------------------------------


def test_a_message_that_no_state_takes_is_dropped(tmp_path: Path) -> None:
    models = {
        "A": counter("a", ' cond="n &lt; 3"'),
        "Echo": ECHO.format(heard="a", next="said"),  # deaf while it is about to say what it heard
    }
    found = values(seen(tmp_path, models))
    assert [value for topic, value in found if topic == "/echo"] == [1, 3]


def test_requests_wait_for_a_state_that_takes_them_and_are_answered_in_order(
    tmp_path: Path,
) -> None:
    models = {
        "Server": SERVER,
        "First": CLIENT.format(name="first", data="true"),
        "Second": CLIENT.format(name="second", data="false"),
    }
    assert seen(tmp_path, models) == [(1.0, "/first", True), (1.0, "/second", False)]


def test_deployed_a_request_that_no_state_takes_is_discarded(tmp_path: Path) -> None:
    models = {"Server": SERVER, "First": CLIENT.format(name="first", data="true")}
    assert seen(tmp_path, models, 3.0, Semantics.DEPLOYED) == []


def test_goals_and_results_wait_for_a_state_that_takes_them(tmp_path: Path) -> None:
    assert seen(tmp_path, {"Server": GOALS, "Client": HASTY}, 4.0) == [(2.0, "/done", 7)]


def test_a_tick_waits_for_a_state_that_takes_it(tmp_path: Path) -> None:
    found = seen(
        tmp_path,
        {"Clock": CLOCK.format(topic="clock_topic")},
        leaf=LEAF,
        parameters='<bt_tick_rate value="4"/>',
    )
    assert found[:2] == [(1.0, "/clock_topic", 1), (1.0, "/policy/ticks", "SUCCESS")]


# --- the end --------------------------------------------------------------------------------------


def test_what_is_due_when_the_time_is_over_still_happens(tmp_path: Path) -> None:
    found = seen(tmp_path, {"A": CLOCK.format(topic="a")}, 2.0)
    assert found == [(1.0, "/a", 1), (2.0, "/a", 2)]


def test_a_tree_that_has_ended_ends_the_run_when_it_would_be_ticked_next(tmp_path: Path) -> None:
    models = {"A": CLOCK.format(topic="a")}
    ends = '<max_time value="9" unit="s"/><bt_tick_rate value="0.4"/>'
    found = seen(tmp_path, models, 9.0, leaf=DONE, parameters=ends)
    assert [item for item in found if item[1] == "/policy/ticks"] == [
        (2.5, "/policy/ticks", "SUCCESS")
    ]
    assert found[-1] == (5.0, "/a", 5)
