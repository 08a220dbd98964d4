"""The definitions that recordings carry, in every form that recorders write them in."""

from __future__ import annotations

from pathlib import Path

import lz4.frame
import pytest

from m2c.language.datatypes import Structure, describe
from m2c.model import DiagnosticLog, InterfaceLibrary
from moon.recording.cdr import Decoder
from moon.recording.definitions import Definitions, UnknownTypeError
from tests.recording import bags
from tests.recording.test_reader_damage import read
from transports.cdr import CdrError

RULE = "=" * 80
SERVICE = "# ask\nint32 a\nstd_msgs/Header h\n---\nbool ok\n"
ACTION = "int32 order\n---\nint32 result\n---\nint32 feedback\n"
PARTS = (
    f"{RULE}\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n"
    f"{RULE}\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
)
IDL_MESSAGE = """// generated
#include "std_msgs/msg/Header.idl"

module p { module msg { typedef double three[3]; struct A {
  @verbatim (language="comment", text="a" "b")
  std_msgs::msg::Header h; @default (value=3) long b; three c; sequence<octet, 4> d; Inner e;
}; struct Inner { long x; }; }; };
"""
IDL_HEADER = """#include "builtin_interfaces/msg/Time.idl"
module std_msgs { module msg { struct Header { builtin_interfaces::msg::Time stamp; string frame_id; }; }; };
"""
IDL_SERVICE = """#include "std_msgs/msg/Header.idl"
module p { module srv { struct S_Request { long a; std_msgs::msg::Header h; };
struct S_Response { boolean ok; }; }; };
"""
ENDS = {"lf": "\n", "crlf": "\r\n", "cr": "\r"}


def fields(made: Structure) -> dict[str, str]:
    return {name: describe(kind) for name, kind in made.fields}


@pytest.mark.parametrize("end", ENDS.values(), ids=ENDS)
@pytest.mark.parametrize("encoding", ["ros2msg", "unknown", ""])
@pytest.mark.parametrize(
    "text",
    [
        f"SRV: p/srv/S\n{SERVICE}{PARTS}",
        f"SRV: p/S\n{SERVICE}{PARTS}",
        f"{RULE}\nSRV: p/srv/S\n{SERVICE}{PARTS}",
        f"{SERVICE}{PARTS}",
        f"\ufeff{SERVICE}{PARTS}",
        SERVICE,
    ],
)
@pytest.mark.parametrize("stored_with", ["p/srv/S_Event", "p/srv/S", "p/srv/S_Request"])
def test_a_service_is_known_by_any_text_of_it(
    text: str, encoding: str, end: str, stored_with: str
) -> None:
    definitions = Definitions()
    definitions.add(stored_with, encoding, text.replace("\n", end))
    event = definitions.structure("p/srv/S_Event")
    assert [name for name, _ in event.fields] == ["info", "request", "response"]
    request = fields(definitions.structure("p/srv/S_Request"))
    assert (list(request), request["a"]) == (["a", "h"], "int32")
    assert fields(definitions.structure("p/srv/S_Response")) == {"ok": "bool"}


@pytest.mark.parametrize("encoding", ["ros2msg", "unknown"])
@pytest.mark.parametrize("header", [True, False])
@pytest.mark.parametrize("part", ["", "_FeedbackMessage", "_SendGoal_Event", "_GetResult_Event"])
@pytest.mark.parametrize("package", ["p", "my_robot_interfaces"])
def test_an_action_is_known_by_any_text_of_it(
    package: str, part: str, header: bool, encoding: str
) -> None:
    definitions, action = Definitions(), f"{package}/action/G"
    text = f"ACTION: {action}\n{ACTION}" if header else ACTION
    definitions.add(f"{action}{part}", encoding, text)
    feedback = definitions.structure(f"{action}_FeedbackMessage")
    assert [name for name, _ in feedback.fields] == ["goal_id", "feedback"]
    assert fields(definitions.structure(f"{action}_Goal")) == {"order": "int32"}


@pytest.mark.parametrize("end", ENDS.values(), ids=ENDS)
@pytest.mark.parametrize("encoding", ["ros2idl", "omgidl", "unknown", ""])
@pytest.mark.parametrize(
    "text",
    [
        IDL_MESSAGE,
        f"{RULE}\nIDL: p/msg/A\n{IDL_MESSAGE}{RULE}\nIDL: std_msgs/msg/Header\n{IDL_HEADER}",
        f"{IDL_MESSAGE}{PARTS}",
    ],
)
def test_idl_with_includes_is_read(text: str, encoding: str, end: str) -> None:
    definitions = Definitions()
    definitions.add("p/msg/A", encoding, text.replace("\n", end))
    found = fields(definitions.structure("p/msg/A"))
    assert list(found) == ["h", "b", "c", "d", "e"]
    assert [found[name] for name in "bcde"] == ["int32", "float64[3]", "byte[<=4]", "p/msg/Inner"]
    assert [name for name, _ in definitions.structure("std_msgs/msg/Header").fields] == [
        "stamp",
        "frame_id",
    ]


@pytest.mark.parametrize("text", [IDL_SERVICE, f"{RULE}\nIDL: p/srv/S\n{IDL_SERVICE}"])
@pytest.mark.parametrize("encoding", ["ros2idl", "unknown"])
def test_a_service_in_idl_is_read(text: str, encoding: str) -> None:
    definitions = Definitions()
    definitions.add("p/srv/S_Event", encoding, text)
    assert len(definitions.structure("p/srv/S_Event").fields) == 3
    assert fields(definitions.structure("p/srv/S_Response")) == {"ok": "bool"}


@pytest.mark.parametrize(
    ("stored_with", "encoding", "text"),
    [
        ("p/msg/A", "ros2msg", "??? a\n"),
        ("p/msg/A", "ros2msg", "strang a\n"),
        ("p/msg/A", "ros2msg", "Other[] a\nint8 x\n"),
        ("p/msg/A", "ros2idl", "module p { module msg { struct A { q::msg::B b; }; }; };"),
        ("p/srv/S_Event", "unknown", "SRV: p/srv/S\nq/B b\n---\n"),
        ("p/msg/A", "ros2idl", "module {"),
        ("p/msg/A", "ros2idl", "union U {};"),
        ("p/msg/A", "ros2msg", "int8 x\n" + "# x" * 500_000),
        ("p/msg/A", "unknown", "\x00\x01"),
        ("p/srv/S_Event", "unknown", "SRV: p/srv/S\n??\n---\n"),
        ("p/srv/S_Event", "ros2idl", "module {"),
        ("p/action/G_FeedbackMessage", "ros2msg", "??\n---\n---\n"),
    ],
)
def test_a_definition_that_cannot_be_read_is_looked_for_elsewhere(
    tmp_path: Path, stored_with: str, encoding: str, text: str
) -> None:
    for name, content in (
        ("msg/A.msg", "int8 x\n"),
        ("srv/S.srv", "int8 x\n---\n"),
        ("action/G.action", "---\n---\nint8 x\n"),
    ):
        path = tmp_path / "p" / name
        path.parent.mkdir(parents=True)
        path.write_text(content)
    library = InterfaceLibrary.load([tmp_path], DiagnosticLog())
    definitions = Definitions(library)
    definitions.add(stored_with, encoding, text)
    assert definitions.structure(stored_with).fields != ()
    alone = Definitions()
    alone.add(stored_with, encoding, text)
    with pytest.raises(UnknownTypeError, match=r"its definition|does not define it"):
        alone.structure(stored_with)


@pytest.mark.parametrize(
    ("encoding", "text"),
    [
        ("ros2msg", "wstring a\n"),
        ("ros2msg", "wstring<=5 a\n"),
        ("ros2msg", "wstring[] a\n"),
        ("ros2idl", "module p { module msg { struct W { wstring a; }; }; };"),
        ("ros2idl", "module p { module msg { struct W { sequence<wstring<3>> a; }; }; };"),
    ],
)
def test_a_wide_string_is_named_as_what_it_is(encoding: str, text: str) -> None:
    definitions = Definitions()
    definitions.add("p/msg/W", encoding, text)
    with pytest.raises(CdrError, match="values of type wstring are not supported"):
        Decoder(definitions.structure("p/msg/W"))


def test_messages_that_are_compressed_by_lz4_are_named_as_that(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    serialize = bags.STORE.serialize_cdr

    def packed(message: object, type_name: str) -> bytes:
        return bytes(lz4.frame.compress(bytes(serialize(message, type_name))))

    monkeypatch.setattr(bags.STORE, "serialize_cdr", packed)
    seen, faults = read(bags.write(tmp_path / "bag", bags.levels(2)))
    assert seen == []
    assert "is compressed by lz4, message by message; only zstd is read so" in str(faults)
