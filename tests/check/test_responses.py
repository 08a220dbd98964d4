"""Responses that certainly answer nothing, and statuses that are none, are found; no others."""

from __future__ import annotations

from pathlib import Path

import pytest

from m2c.check.reading import read_and_check
from m2c.model import DiagnosticLog

SEND = '<ros_service_send_response name="tick"><field name="status" expr="{}"/></ros_service_send_response>'
ONE = SEND.format(1)
TWO = SEND.format(2)
MAYBE = f'<if cond="busy">{ONE}</if>'
ELSE = f'<if cond="busy">{ONE}<else/>{TWO}</if>'
AGAIN = "the one at "
NEVER = "on every path to it each is answered before, or none is taken"


def state(name: str, *content: str, entry: str = "") -> str:
    return f'<state id="{name}"><onentry>{entry}</onentry>{"".join(content)}</state>'


def tick(body: str = "", target: str = "") -> str:
    to = f' target="{target}"' if target else ""
    return f'<ros_service_handle_request name="tick"{to}>{body}</ros_service_handle_request>'


def go(target: str, event: str = "", body: str = "", cond: str = "") -> str:
    on = f' event="{event}"' if event else ""
    holds = f' cond="{cond}"' if cond else ""
    return f'<transition target="{target}"{on}{holds}>{body}</transition>'


def findings(folder: Path, *states: str, kind: str = "TickAction") -> list[str]:
    for name in ("TickAction", "TickCondition", "Other"):
        path = folder / "interfaces" / "t" / "srv" / f"{name}.srv"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("---\nint8 status\n")
    path = folder / "m.scxml"
    path.write_text(
        '<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" name="M">\n'
        f'<ros_service_server name="tick" service_name="/m/tick" type="t/{kind}"/>\n'
        '<datamodel><data id="busy" type="bool" expr="false"/>'
        '<data id="n" type="int8" expr="7"/></datamodel>\n' + "\n".join(states) + "</scxml>"
    )
    log = DiagnosticLog()
    read_and_check([path], [], log)
    rules = ("response-without-request", "bad-status")
    return [str(item) for item in log.diagnostics if item.rule in rules or item.severity == "error"]


@pytest.mark.parametrize(
    ("states", "says"),
    [
        ((state("a", tick(ONE + TWO)),), AGAIN),
        ((state("a", tick(ONE, "b")), state("b", go("a"), entry=TWO)), AGAIN),
        ((state("a", tick("", "b")), state("b", go("a", body=TWO), entry=ONE)), NEVER),
        ((state("a", tick(ONE, "b")), state("b", tick(ONE), go("a", "e", TWO))), NEVER),
        ((state("a", tick(ONE), entry=TWO),), NEVER),
        ((state("a", tick(ONE), go("a", "e", TWO)),), NEVER),
        ((state("a", tick(ELSE + ONE)),), AGAIN),
        ((state("a", tick(MAYBE + ONE)),), AGAIN),
        ((state("a", tick(ELSE, "b")), state("b", go("a"), entry=MAYBE)), NEVER),
    ],
)
def test_a_response_that_no_request_waits_for_is_found(
    tmp_path: Path, states: tuple[str, ...], says: str
) -> None:
    (found,) = findings(tmp_path, *states)
    assert "warning: <ros_service_send_response>: no request to /m/tick waits" in found
    assert says in found
    assert found.endswith("[response-without-request]")


@pytest.mark.parametrize(
    "states",
    [
        (state("a", tick(ONE)),),
        (state("a", tick("", "b")), state("b", go("a"), entry=ONE)),
        (state("a", tick(ELSE)),),
        (state("a", tick(f'<if cond="busy">{ONE}</if><if cond="!busy">{TWO}</if>')),),
        # busy: what comes meanwhile is answered at once, what waits later
        (state("a", tick("", "b")), state("b", tick(TWO), go("a", "done", ONE))),
        # two wait
        (
            state("a", tick("", "b")),
            state("b", tick("", "c")),
            state("c", go("a"), entry=ONE + TWO),
        ),
        # any number waits
        (state("a", tick(), go("a", "done", ONE + ONE + ONE)),),
        # answered in one of two ways
        (
            state("a", tick(MAYBE, "b")),
            state("b", go("a", cond="busy"), go("a", body=ONE)),
        ),
        # the block may end before its response, and somebody sees to it
        (
            state("a", tick("", "b")),
            state("b", go("a", "error.execution", ONE), go("a", "e"), entry=ONE),
        ),
    ],
)
def test_a_response_that_some_request_may_wait_for_is_left_alone(
    tmp_path: Path, states: tuple[str, ...]
) -> None:
    assert findings(tmp_path, *states) == []


@pytest.mark.parametrize("kind", ["TickAction", "TickCondition"])
@pytest.mark.parametrize("value", ["3", "-1", "1 + 2", "0.5"])
def test_a_status_that_no_data_can_change_and_that_is_none_is_an_error(
    tmp_path: Path, kind: str, value: str
) -> None:
    found = findings(tmp_path, state("a", tick(SEND.format(value))), kind=kind)
    assert found
    expected = "is not a status; one of 0 (SUCCESS), 1 (FAILURE), 2 (RUNNING) [bad-status]"
    assert value == "0.5" or (len(found) == 1 and found[0].endswith(expected)), found


@pytest.mark.parametrize(
    ("kind", "value"),
    [("TickAction", "0"), ("TickAction", "1 + 1"), ("TickAction", "n"), ("Other", "3")],
)
def test_a_status_that_is_one_or_may_be_one_or_of_another_service_is_left_alone(
    tmp_path: Path, kind: str, value: str
) -> None:
    assert findings(tmp_path, state("a", tick(SEND.format(value))), kind=kind) == []
