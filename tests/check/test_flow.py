"""What a machine can never do: shadowed transitions, unreachable states, unanswered requests."""

from __future__ import annotations

from pathlib import Path

import pytest

from m2c.check.flow import check_flow
from m2c.check.paths import truth
from m2c.language.parsing import parse_expression
from m2c.model import DiagnosticLog, InterfaceLibrary, Position, read_machine

HEAD = '<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" name="M" initial="a">\n'
TICK = '<ros_service_server service_name="/s/tick" type="std_srvs/Trigger"/>'
TAKE = '<ros_service_handle_request name="/s/tick"'
ANSWER = '<ros_service_send_response name="/s/tick"/>'
ACTION = '<ros_action_server name="act" action_name="/act" type="example_interfaces/Fibonacci"/>'
GOAL = '<ros_action_handle_goal name="act"'
ACCEPT = '<ros_action_accept_goal name="act" goal_id="_action.goal_id"/>'
SUCCEED = '<ros_action_succeed name="act" goal_id="1"/>'


def found(tmp_path: Path, body: str, *rules: str) -> list[str]:
    """The flow's findings on a machine whose text from line 2 on is ``body``."""
    path = tmp_path / "model.scxml"
    path.write_text(HEAD + body + "</scxml>")
    log = DiagnosticLog()
    machine = read_machine(path, log, InterfaceLibrary())
    assert machine is not None, log.diagnostics
    check_flow(machine, log)
    return [
        str(item).removeprefix(f"{path}:")
        for item in log.diagnostics
        if not rules or item.rule in rules
    ]


SHADOWED = [
    (
        '<transition target="b"/>\n<transition event="e" target="a"/>',
        "3:1: warning: <transition>: never taken: the transition at 2:15 waits for no event and always "
        "holds; give that one an event or a condition, or remove this one [shadowed-transition]",
    ),
    (
        '<transition event="e" target="a"/>\n<transition target="b"/>',
        "2:15: warning: <transition>: never taken: the transition at 3:1 waits for no event and always "
        "holds; give that one an event or a condition, or remove this one [shadowed-transition]",
    ),
    (
        '<transition target="b"/>\n<transition cond="n == 1" target="a"/>',
        "3:1: warning: <transition>: never taken: the transition at 2:15 waits for no event and always "
        "holds; give that one an event or a condition, or remove this one [shadowed-transition]",
    ),
    (
        '<transition event="*" target="b"/>\n<transition event="e" cond="n == 1" target="a"/>',
        "3:1: warning: <transition>: never taken: the transition at 2:15 takes its event too and has no "
        "condition; put it before that one, or give that one a condition [shadowed-transition]",
    ),
    (
        '<transition event="e.*" target="b"/>\n<transition event="e.f" target="a"/>',
        "3:1: warning: <transition>: never taken: the transition at 2:15 takes its event too and has no "
        "condition; put it before that one, or give that one a condition [shadowed-transition]",
    ),
    (
        '<transition event="e" target="b"/>\n<transition event="e.f.g" target="a"/>',
        "3:1: warning: <transition>: never taken: the transition at 2:15 takes its event too and has no "
        "condition; put it before that one, or give that one a condition [shadowed-transition]",
    ),
    (
        '<transition event="e" cond="1 &lt; 2" target="b"/>\n<transition event="e" target="a"/>',
        "3:1: warning: <transition>: never taken: the transition at 2:15 takes the same event and has no "
        "condition; put it before that one, or give that one a condition [shadowed-transition]",
    ),
]


@pytest.mark.parametrize(("transitions", "message"), SHADOWED, ids=[str(i) for i in range(7)])
def test_a_transition_that_never_gets_its_turn_is_reported_with_the_one_before_it(
    tmp_path: Path, transitions: str, message: str
) -> None:
    data = '<datamodel><data id="n" type="int8"/></datamodel>'
    body = f'<state id="a">{transitions}</state>{data}<state id="b"/>'
    assert found(tmp_path, body, "shadowed-transition") == [message]


@pytest.mark.parametrize(
    "transitions",
    [
        '<transition event="e" target="b"/><transition event="*" target="a"/>',
        '<transition event="e.f" target="b"/><transition event="e" target="a"/>',
        '<transition event="e" target="b"/><transition event="ef" target="a"/>',
        '<transition event="e" cond="n == 1" target="b"/><transition event="e" target="a"/>',
        '<transition cond="n == 1" target="b"/><transition event="e" target="a"/>',
        '<transition event="e" cond="1 &gt; 2" target="b"/><transition event="e" target="b"/>',
    ],
)
def test_a_transition_that_can_have_its_turn_is_not_called_shadowed(
    tmp_path: Path, transitions: str
) -> None:
    data = '<datamodel><data id="n" type="int8"/></datamodel>'
    body = f'{data}<state id="a">{transitions}</state><state id="b"/>'
    assert found(tmp_path, body, "shadowed-transition") == []


def test_a_star_does_not_take_what_arrives_on_a_channel(tmp_path: Path) -> None:
    body = f'{TICK}<state id="a"><transition event="*"/>{TAKE}>{ANSWER}</ros_service_handle_request></state>'
    assert found(tmp_path, body) == []


def test_a_state_behind_a_condition_that_never_holds_cannot_be_reached(tmp_path: Path) -> None:
    body = '<state id="a"><transition event="e" cond="false" target="b"/></state><state id="b"/>'
    assert found(tmp_path, body) == [
        "2:43: warning: <transition>: never taken: its condition never holds; correct the condition, or "
        "remove the transition [never-taken]",
        "2:70: warning: <state>: state `b` cannot be reached from `a` [unreachable-state]",
    ]


def test_a_target_of_probability_zero_cannot_be_reached(tmp_path: Path) -> None:
    targets = '<target id="a" prob="1"/><target id="b" prob="0"/>'
    body = f'<state id="a"><transition event="e">{targets}</transition></state><state id="b"/>'
    assert found(tmp_path, body) == [
        "2:108: warning: <state>: state `b` cannot be reached from `a` [unreachable-state]"
    ]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("true", True),
        ("false", False),
        ("1 == 2", False),
        ("!true", False),
        ("!(1 > 2)", True),
        ("'' || 0", False),
        ("false && x", False),
        ("x && false", False),
        ("true || x", True),
        ("x || true", True),
        ("x.y || true", None),
        ("x.y && false", False),
        ("!(x.y && false)", None),
        ("!(x && false)", True),
        ("x", None),
        ("x && true", None),
        ("x ? true : 1", True),
        ("x.y ? true : 1", None),
        ("x ? 0 : ''", False),
        ("true ? x : false", None),
        ("Math.random() < 0.5", None),
        ("Math.max(1, 2) > 1", True),
        ("undefined.x", False),
        ("9 ** 9 ** 9 > 1", True),
    ],
)
def test_a_condition_is_settled_only_if_no_data_can_change_it(
    text: str, expected: bool | None
) -> None:
    log = DiagnosticLog()
    expression = parse_expression(text, Position("x"), "transition", log)
    assert expression is not None, log.diagnostics
    assert truth(expression) is expected


UNANSWERED = (
    "state `a` takes a request to /s/tick that no path ever answers: its caller would never be "
    "answered; add <ros_service_send_response> to a path from here [request-unanswered]"
)


@pytest.mark.parametrize(
    "states",
    [
        # taken, and nothing is ever sent
        f'<state id="a">{TAKE}/></state>',
        # the only answer is behind a condition that never holds
        f'<state id="a">{TAKE}><if cond="false">{ANSWER}</if></ros_service_handle_request></state>',
        f'<state id="a">{TAKE} target="b"/></state>'
        f'<state id="b">{TAKE}/><transition event="e" cond="false">{ANSWER}</transition></state>',
        # the only answer is that to a later request
        f'<state id="a">{TAKE} target="b"/></state>'
        f'<state id="b">{TAKE} target="b">{ANSWER}</ros_service_handle_request></state>',
        f'<state id="a">{TAKE} target="b"/></state>'
        f'<state id="b">{TAKE} target="c"/></state>'
        f'<state id="c"><transition target="b">{ANSWER}</transition></state>',
        # the answer is on the way in, which is not walked again
        f'<state id="a"><onentry>{ANSWER}</onentry>{TAKE}/></state>',
    ],
)
def test_a_request_that_no_path_answers_is_named_with_state_and_service(
    tmp_path: Path, states: str
) -> None:
    warnings = found(tmp_path, TICK + states, "request-unanswered")
    assert [text for text in warnings if "state `a`" in text] == [
        f"2:83: warning: <ros_service_handle_request>: {UNANSWERED}"
        if "onentry" not in states
        else f"2:{83 + 19 + len(ANSWER)}: warning: <ros_service_handle_request>: {UNANSWERED}"
    ]


@pytest.mark.parametrize(
    "states",
    [
        f'<state id="a">{TAKE}>{ANSWER}</ros_service_handle_request></state>',
        f'<state id="a">{TAKE}><if cond="n == 1">{ANSWER}</if></ros_service_handle_request></state>',
        f'<state id="a"><onexit>{ANSWER}</onexit>{TAKE} target="a"/></state>',
        f'<state id="a"><onentry>{ANSWER}</onentry>{TAKE} target="a"/></state>',
        f'<state id="a">{TAKE} target="b"/></state><state id="b"><onentry>{ANSWER}</onentry></state>',
        # later, on another event
        f'<state id="a">{TAKE}/><transition event="e">{ANSWER}</transition></state>',
        f'<state id="a">{TAKE} target="b"/></state>'
        f'<state id="b"><transition after="1s" target="c"/></state>'
        f'<state id="c"><transition target="a">{ANSWER}</transition></state>',
        # a later request brings two answers: its own and the older one's
        f'<state id="a">{TAKE} target="b"/></state>'
        f'<state id="b">{TAKE} target="b">{ANSWER}{ANSWER}</ros_service_handle_request></state>',
        f'<state id="a">{TAKE} target="b"/></state>'
        f'<state id="b">{TAKE} target="c">{ANSWER}</ros_service_handle_request></state>'
        f'<state id="c"><transition target="a">{ANSWER}</transition></state>',
        # the later request's answer may be left out, and another event answers
        f'<state id="a">{TAKE} target="b"/></state>'
        f'<state id="b">{TAKE} target="c">{ANSWER}</ros_service_handle_request></state>'
        f'<state id="c"><transition event="e" target="a">{ANSWER}</transition></state>',
    ],
)
def test_a_request_that_some_path_answers_is_not_reported(tmp_path: Path, states: str) -> None:
    data = '<datamodel><data id="n" type="int8"/></datamodel>'
    assert found(tmp_path, TICK + data + states, "request-unanswered") == []


def test_a_request_in_a_state_nobody_reaches_is_not_reported(tmp_path: Path) -> None:
    body = f'{TICK}<state id="a">{TAKE}>{ANSWER}</ros_service_handle_request></state>'
    assert found(tmp_path, f'{body}<state id="b">{TAKE}/></state>', "request-unanswered") == []


@pytest.mark.parametrize(
    ("states", "message"),
    [
        (
            f'<state id="a">{GOAL}/></state>',
            "takes a goal of /act that no path ever accepts or rejects: its client would wait for ever; "
            "add <ros_action_accept_goal> or <ros_action_reject_goal>",
        ),
        (
            f'<state id="a">{GOAL}>{ACCEPT}</ros_action_handle_goal></state>',
            "takes a goal of /act that is accepted and never ends: its client would never get a result; "
            "add <ros_action_succeed>, <ros_action_aborted> or <ros_action_canceled>",
        ),
        (
            f'<state id="a">{GOAL}>{SUCCEED}</ros_action_handle_goal></state>',
            "takes a goal of /act that no path ever accepts or rejects: its client would wait for ever; "
            "add <ros_action_accept_goal> or <ros_action_reject_goal>",
        ),
        (
            f'<state id="a">{GOAL} target="b"/></state><state id="b"><transition event="e">{SUCCEED}'
            '<ros_action_reject_goal name="act" goal_id="2"/></transition></state>',
            "takes a goal of /act, and goals are ended there that no state accepts; "
            "add <ros_action_accept_goal>",
        ),
        (f'<state id="a">{GOAL}>{ACCEPT}{SUCCEED}</ros_action_handle_goal></state>', ""),
        (
            f'<state id="a">{GOAL}>{ACCEPT}</ros_action_handle_goal>'
            f'<transition event="e">{SUCCEED}</transition></state>',
            "",
        ),
        (
            f'<state id="a">{GOAL}><ros_action_reject_goal name="act" goal_id="1"/></ros_action_handle_goal></state>',
            "",
        ),
        (
            f'<state id="a">{GOAL}>{ACCEPT}<ros_action_start_thread name="act" thread_id="0" '
            'goal_id="1"/></ros_action_handle_goal></state><ros_action_thread name="act" initial="t">'
            '<state id="t"><ros_action_handle_thread_start name="act">'
            f"{SUCCEED}</ros_action_handle_thread_start></state></ros_action_thread>",
            "",
        ),
    ],
)
def test_a_goal_must_be_decided_and_end(tmp_path: Path, states: str, message: str) -> None:
    place = 2, len(ACTION) + 15
    text = (
        f"{place[0]}:{place[1]}: warning: <ros_action_handle_goal>: state `a` {message} "
        "[request-unanswered]"
    )
    assert found(tmp_path, ACTION + states, "request-unanswered") == ([text] if message else [])


@pytest.mark.parametrize(
    ("event", "answer", "what"),
    [
        ("bt_tick", "bt_return_status", "takes a tick"),
        ("bt_halt", "bt_return_halted", "takes a halt"),
    ],
)
def test_a_plugin_must_answer_the_tree(tmp_path: Path, event: str, answer: str, what: str) -> None:
    assert found(tmp_path, f'<state id="a"><{event}/></state>') == [
        f"2:15: warning: <{event}>: state `a` {what} that no path ever answers: the tree would wait in "
        f"vain; add <{answer}> [request-unanswered]"
    ]
    status = ' status="SUCCESS"' if event == "bt_tick" else ""
    assert found(tmp_path, f'<state id="a"><{event}><{answer}{status}/></{event}></state>') == []


def test_a_state_that_is_left_at_once_discards_no_request(tmp_path: Path) -> None:
    take = f"{TAKE}>{ANSWER}</ros_service_handle_request>"
    go = '<transition event="e" target="b"/>'
    for cond, count in (("", 0), ('cond="1 == 1"', 0), ('cond="false"', 1)):
        body = f'{TICK}<state id="a">{take}{go}</state><state id="b"><transition {cond} target="a"/></state>'
        assert len(found(tmp_path, body, "request-discarded")) == count


@pytest.mark.parametrize(
    ("transitions", "endless"),
    [
        ('<transition target="a"/><transition cond="n == 1" target="b"/>', True),
        ('<transition cond="n == 1" target="b"/><transition target="a"/>', False),
        ('<transition cond="1 == 2" target="b"/><transition target="a"/>', True),
    ],
)
def test_a_loop_that_an_earlier_transition_may_leave_is_not_called_endless(
    tmp_path: Path, transitions: str, endless: bool
) -> None:
    data = '<datamodel><data id="n" type="int8"/></datamodel>'
    body = f'{data}<state id="a">{transitions}</state><state id="b"/>'
    assert bool(found(tmp_path, body, "eventless-cycle")) is endless
