"""Lines of text and of JSON: short, on one line, harmless to a terminal, whatever was sent."""

from __future__ import annotations

import json

import msgspec
import pytest

from moon.tap.output import json_of
from moon.tap.render import Renderer
from moon.tap.stream import Line
from moon.wording import MAX_DATA, compact

UUID = {"uuid": list(range(0xA0, 0xB0))}


def text(line: Line) -> str:
    return Renderer(colour=False).text(line).partition("  ")[2]


def part(name: str, data, kind="message") -> str:
    line = Line(0, kind, "/go/_action/x", "node", data, action="/go", part=name)
    return text(line).split("node")[1].strip()


@pytest.mark.parametrize(
    ("name", "data", "expected"),
    [
        ("goal", {"goal_id": UUID, "goal": {"poi": 1}}, "goal a0a1a2a3  poi: 1"),
        ("goal", {"goal_id": UUID, "goal": {}}, "goal a0a1a2a3"),
        ("goal response", {"accepted": True, "stamp": {}}, "goal response  accepted"),
        ("goal response", {"accepted": False, "stamp": {}}, "goal response  rejected"),
        ("feedback", {"goal_id": UUID, "feedback": {"left": 3}}, "feedback a0a1a2a3  left: 3"),
        ("result request", {"goal_id": UUID}, "result request a0a1a2a3"),
        ("result", {"status": 4, "result": {"ok": True}}, "result  status: succeeded, ok: true"),
        ("result", {"status": 77, "result": {}}, "result  status: 77"),
        ("cancel", {"goal_info": {"goal_id": UUID}}, "cancel a0a1a2a3"),
        ("cancel response", {"return_code": 2}, "cancel response  unknown goal"),
        (
            "status",
            {"status_list": [{"goal_info": {"goal_id": UUID}, "status": 2}]},
            "status  a0a1a2a3: executing",
        ),
        ("goal", {"something": "else"}, "goal  something: 'else'"),
        ("goal", [1, 2], "goal  [1, 2]"),
        ("result", {"status": "odd", "result": 3}, "result  status: 'odd', result: 3"),
        ("status", {"status_list": 3}, "status  status_list: 3"),
        (
            "goal",
            {"goal_id": {"uuid": "abc"}, "goal": {}},
            "goal  goal_id: {uuid: 'abc'}, goal: {}",
        ),
    ],
)
def test_parts_of_an_action_are_told_in_words(name, data, expected) -> None:
    assert part(name, data) == expected


def test_the_action_is_named_instead_of_its_channel() -> None:
    line = Line(0, "message", "/go/_action/feedback", "node", {}, action="/go", part="feedback")
    assert text(line).startswith("/go  ")


def test_an_unknown_answerer_is_a_question_mark_and_none_is_a_dash() -> None:
    assert " ← ? " in text(Line(0, "response", "/s", "", {"a": 1}, client="c"))
    assert " ← - " in text(Line(0, "response", "/s", "", client="c", error="timeout: /s: late"))


def test_a_message_taken_is_named_by_its_publisher_and_number() -> None:
    taken = Line(0, "taken", "/level", "Judge", client="Sensor", call=7)
    assert Renderer(colour=False).text(taken).endswith("▸ Judge         Sensor 7")


def test_a_line_has_no_control_characters() -> None:
    line = Line(0, "response", "/a\x1b[2J", "no\nde", {"k\x1b": "v\x07"}, error="remote\nerror")
    assert Renderer(colour=False).text(line).isprintable()


def test_a_long_message_is_cut() -> None:
    assert len(compact({"image": [1] * 1_000_000})) == MAX_DATA
    assert len(compact({"text": "x" * 1_000_000})) == MAX_DATA


def test_a_deep_message_is_cut() -> None:
    deep: list = []
    for _ in range(5_000):
        deep = [deep]
    assert compact(deep) == "[" * 13 + "…" + "]" * 13


@pytest.mark.parametrize("data", [{"uuid": [300, "x"]}, {"uuid": [None]}, {"uuid": []}])
def test_what_is_only_called_uuid_is_shown_as_it_is(data) -> None:
    assert compact({"id": data})


def test_json_leaves_out_what_is_not_known() -> None:
    assert json.loads(json_of(Line(1, "message", "/a", "n", {"data": 1}))) == {
        "format_version": 1,
        "stamp_ns": 1,
        "kind": "message",
        "channel": "/a",
        "source": "n",
        "data": {"data": 1},
    }


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        ({"x": float("nan"), "y": float("inf")}, {"x": None, "y": None}),
        ({"x": b"\x00\x01"}, {"x": "AAE="}),
        ({"x": msgspec.msgpack.Ext(5, b"\x01")}, {"x": {"ext": 5, "data": "AQ=="}}),
        ({None: 1, "b": [{None: 2}]}, {"None": 1, "b": [{"None": 2}]}),
    ],
)
def test_json_has_a_form_for_all_that_messagepack_can_carry(data, expected) -> None:
    assert json.loads(json_of(Line(1, "message", "/a", "n", data)))["data"] == expected


def test_json_of_a_message_nested_too_deeply_is_cut() -> None:
    deep: list = []
    for _ in range(100_000):
        deep = [deep]
    assert "…" in json_of(Line(1, "message", "/a", "n", deep)).decode()
