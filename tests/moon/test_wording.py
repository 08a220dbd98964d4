"""Values in words: numbers by the constants of their definition, where no doubt is possible."""

from __future__ import annotations

from pathlib import Path

import pytest

from m2c.model import DiagnosticLog
from m2c.model.interfaces import InterfaceLibrary
from moon.tap.render import Renderer
from moon.tap.stream import Line
from moon.wording import Wording, compact, value_text


def worded(folder: Path, definition: str, **data: object) -> str:
    """``data`` as a message with this definition."""
    path = folder / "p" / "msg" / "M.msg"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(definition)
    log = DiagnosticLog()
    library = InterfaceLibrary.load([folder], log)
    text = Wording(library).message(data, "p/msg/M")
    assert not log.has_errors, log.diagnostics
    return text


TWO = "int8 OFF=0\nint8 ON=1\n"


@pytest.mark.parametrize(
    ("definition", "data", "expected"),
    [
        (f"{TWO}int8 lamp", {"lamp": 1}, "lamp: ON (1)"),
        (f"{TWO}int8 lamp", {"lamp": 7}, "lamp: 7"),
        (f"{TWO}int8 lamp", {"lamp": 1.0}, "lamp: ON (1)"),
        (f"{TWO}int8 lamp", {"lamp": True}, "lamp: true"),
        (f"{TWO}int8[] lamps", {"lamps": [0, 1, 2]}, "lamps: [OFF (0), ON (1), 2]"),
        # whose they are
        (f"{TWO}uint8 lamp", {"lamp": 1}, "lamp: 1"),
        (f"{TWO}int8 lamp\nint8 fan", {"lamp": 1, "fan": 1}, "lamp: 1, fan: 1"),
        (f"{TWO}int8 lamp\nint16 fan", {"lamp": 1, "fan": 1}, "lamp: ON (1), fan: 1"),
        (
            "uint8 LAMP_OFF=0\nuint8 LAMP_ON=1\nuint8 FAN_SLOW=0\nuint8 FAN_FAST=1\nuint8 lamp\nuint8 fan",
            {"lamp": 1, "fan": 1},
            "lamp: LAMP_ON (1), fan: FAN_FAST (1)",
        ),
        (
            "uint8 FAN_OFF=0\nuint8 FAN_ON=1\nuint8 FAN_MODE_A=0\nuint8 FAN_MODE_B=1\nuint8 fan\nuint8 fan_mode",
            {"fan": 1, "fan_mode": 1},
            "fan: FAN_ON (1), fan_mode: FAN_MODE_B (1)",
        ),
        # no enumeration
        ("int8 MOST=10\nint8 count", {"count": 10}, "count: 10"),
        (f"{TWO}int8 ALSO=1\nint8 lamp", {"lamp": 1}, "lamp: 1"),
        ("float32 A=0.0\nfloat32 B=1.0\nfloat32 x", {"x": 1.0}, "x: 1"),
        # what is no number
        ("string s\nbool b", {"s": "on", "b": False}, "s: 'on', b: false"),
        ("string s", {"s": "it's \n"}, "s: 'it\\'s \\n'"),
        ("int8 a", {"b": None}, "b: null"),
    ],
)
def test_a_number_has_a_name_where_no_doubt_is_possible(
    tmp_path: Path, definition: str, data: dict[str, object], expected: str
) -> None:
    assert worded(tmp_path, definition, **data) == expected


@pytest.mark.parametrize("part", ["_Response", "_Goal", "_GetResult_Response"])
def test_services_and_actions_have_names_too(tmp_path: Path, part: str) -> None:
    for kind, text in (("srv", f"---\n{TWO}int8 lamp"), ("action", f"{TWO}int8 lamp\n---\n{TWO}int8 lamp\n---\n")):  # fmt: skip
        path = tmp_path / "p" / kind / f"Lamp.{kind}"
        path.parent.mkdir(parents=True)
        path.write_text(text)
    wording = Wording(InterfaceLibrary.load([tmp_path], DiagnosticLog()))
    kind = "srv" if part == "_Response" else "action"
    assert wording.message({"lamp": 1}, f"p/{kind}/Lamp{part}") == "lamp: ON (1)"


def test_messages_in_messages_have_names(tmp_path: Path) -> None:
    path = tmp_path / "p" / "msg" / "Lamp.msg"
    path.parent.mkdir(parents=True)
    path.write_text(f"{TWO}int8 lamp")
    data = {"one": {"lamp": 1}, "more": [{"lamp": 0}]}
    assert worded(tmp_path, "Lamp one\nLamp[] more", **data) == (
        "one: {lamp: ON (1)}, more: [{lamp: OFF (0)}]"
    )


def test_a_type_that_nothing_defines_leaves_numbers_as_they_are() -> None:
    wording = Wording(InterfaceLibrary())
    for name in ("q/srv/Other_Response", "", "no type", "q/srv/X", "a/b/c/d"):
        assert wording.message({"status": 1}, name) == "status: 1"


def test_a_tap_says_what_a_tick_was_answered() -> None:
    kind = "bt_interfaces/srv/TickAction_Response"
    line = Line(0, "response", "/s/tick", "s", {"status": 2, "is_ok": True}, kind)
    text = Renderer(False, Wording(InterfaceLibrary())).text(line)
    assert text.endswith("status: RUNNING (2), is_ok: true")


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (True, "true"),
        (None, "null"),
        (0.1, "0.1"),
        (0.1234567890123, "0.1234567890123"),
        (1e300, "1e+300"),
        (float("nan"), "NaN"),
        (float("-inf"), "-Infinity"),
        ("dock", "'dock'"),
        ({"a": [1, "x"]}, "{a: [1, 'x']}"),
    ],
)
def test_a_value_is_told_as_models_write_it_with_all_its_digits(
    value: object, expected: str
) -> None:
    assert value_text(value) == expected


def test_a_long_value_is_cut() -> None:
    assert len(value_text("x" * 1000)) == len(compact({"a": "x" * 1000})) == 160
