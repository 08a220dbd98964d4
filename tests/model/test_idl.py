"""Definitions in IDL: they say what a .msg, .srv or .action says."""

from __future__ import annotations

import itertools
import shutil
import sys
from functools import partial
from pathlib import Path

import pytest

from m2c.language.datatypes import Structure, describe
from m2c.model import DiagnosticLog, InterfaceLibrary
from tests.model.test_interfaces import library as of_package_p

HEAD = """// generated from rosidl_adapter/resource/msg.idl.em
#include "std_msgs/msg/Header.idl"
/* two
   lines */
"""


library = partial(of_package_p, ending="idl")
"""A library of package ``p``; ``A_msg="…"`` is ``p/msg/A.idl``."""


def message(body: str, before: str = "") -> str:
    return f"{HEAD}module p {{ module msg {{\n{before}struct A {{\n{body}\n}};\n}}; }};\n"


def said(made: Structure) -> list[str]:
    """The fields, constants and defaults of ``made``; IDL has one name for char and uint8."""
    fields = [f"{describe(kind).replace('char', 'uint8')} {name}" for name, kind in made.fields]
    return [*fields, *map(str, made.defaults), *(f"{n}={v!r}" for n, _, v in made.constants)]


@pytest.mark.parametrize(
    ("field", "meaning"),
    [
        ("boolean a;", "bool a"),
        ("octet a;", "byte a"),
        ("float a;", "float32 a"),
        ("double a;", "float64 a"),
        ("short a;", "int16 a"),
        ("unsigned short a;", "uint16 a"),
        ("long a;", "int32 a"),
        ("unsigned  long a;", "uint32 a"),
        ("long long a;", "int64 a"),
        ("unsigned long long a;", "uint64 a"),
        ("int8 a;", "int8 a"),
        ("uint64 a;", "uint64 a"),
        ("string a;", "string a"),
        ("string<5> a;", "string a"),
        ("wstring a;", "string a"),
        ("sequence<double> a;", "float64[] a"),
        ("sequence<string<4>, 3> a;", "string[<=3] a"),
        ("double a[36];", "float64[36] a"),
        ("std_msgs::msg::Header a;", "std_msgs/msg/Header a"),
        ("sequence<std_msgs::msg::Header, 2> a;", "std_msgs/msg/Header[<=2] a"),
        ('@verbatim (language="comment", text="a (b; }" "c")\n@unit(value="m") long a;', "int32 a"),
        ("@key long a; // why", "int32 a"),
        ("@a::b(1) long a;", "int32 a"),
    ],
)
def test_every_form_of_a_member_is_read(tmp_path: Path, field: str, meaning: str) -> None:
    types, log = library(tmp_path, A_msg=message(field))
    assert said(types.message("p/A")) == [meaning]
    assert log.diagnostics == []


def test_constants_defaults_and_type_definitions_are_read(tmp_path: Path) -> None:
    before = (
        'module A_Constants { const int32 LOW = -1; const string NAME = "a" "b"; };\n'
        "typedef double double__3[3];\ntypedef sequence<long> numbers;\n"
    )
    body = (
        'double__3 a;\nnumbers b;\n@default (value=5)\nlong c, d;\n@default (value="x\\"y")\nstring e;\n'
        '@default (value="(1, 2,)")\nsequence<int8> f;\n@default (value=TRUE)\nboolean g;\n'
        "@default(value=-0.5)\ndouble h;"
    )  # fmt: skip
    types, log = library(tmp_path, A_msg=message(body, before))
    assert said(types.message("p/A")) == [
        *("float64[3] a", "int32[] b", "int32 c", "int32 d", "string e", "int8[] f", "bool g", "float64 h"),
        *("('c', 5)", "('d', 5)", "('e', 'x\"y')", "('f', (1, 2))", "('g', True)", "('h', -0.5)"),
        *("LOW=-1", "NAME='ab'"),
    ]  # fmt: skip
    assert log.diagnostics == []


@pytest.mark.parametrize("before", ["struct B;", "enum E { X, Y };", "struct A;"])
def test_what_ros_2_reads_and_makes_nothing_of_is_passed_over(tmp_path: Path, before: str) -> None:
    types, log = library(tmp_path, A_msg=message("long a;", before))
    assert said(types.message("p/A")) == ["int32 a"]
    assert log.diagnostics == []


def test_services_and_actions_have_their_parts(tmp_path: Path) -> None:
    def module(kind: str, *names: str) -> str:
        parts = (f"struct {name} {{ long {name[-1]}; }};" for name in names)
        return f"module p {{ module {kind} {{ {' '.join(parts)} }}; }};"

    types, log = library(
        tmp_path,
        S_srv=module("srv", "S_Request", "S_Response"),
        G_action=module("action", "G_Goal", "G_Result", "G_Feedback"),
    )
    service, action = types.service("p/S"), types.action("p/G")
    parts = (service.request, service.response, action.goal, action.result, action.feedback)
    assert [said(part) for part in parts] == [["int32 t"], ["int32 e"], ["int32 l"], ["int32 t"], ["int32 k"]]  # fmt: skip
    assert "p/srv/S" in types.names("srv")
    assert log.diagnostics == []


@pytest.mark.parametrize(
    ("kind", "names", "finding"),
    [
        ("srv", ("Response", "Request"), "`S_Response` stands before `S_Request`"),
        ("action", ("Goal", "Feedback", "Result"), "`S_Feedback` stands before `S_Result`"),
        ("srv", ("Request", "Response", "Event"), "`p::srv::S_Event` is a further structure"),
        ("action", ("Goal", "Result"), "no struct S_Feedback is defined"),
        ("srv", ("Request",), "no struct S_Response is defined"),
    ],
)
def test_parts_are_those_of_one_type_in_their_order(
    tmp_path: Path, kind: str, names: tuple[str, ...], finding: str
) -> None:
    parts = " ".join(f"struct S_{name} {{ long a; }};" for name in names)
    text = f"module p {{ module {kind} {{ {parts} }}; }};"
    types, log = library(tmp_path, **{f"S_{kind}": text})
    assert types.service("p/S") if kind == "srv" else types.action("p/S")
    assert [str(item) for item in log.diagnostics if finding in str(item)] != []


def test_a_structure_without_fields_has_none(tmp_path: Path) -> None:
    types, log = library(tmp_path, A_msg=message("uint8 structure_needs_at_least_one_member;"))
    assert types.message("p/A").fields == ()
    assert log.diagnostics == []


@pytest.mark.parametrize(
    ("text", "finding"),
    [
        (message("long a"), "8:1: error: `}` stands where `;` is expected [bad-interface]"),
        (message("long;"), "7:5: error: `;` stands where a name is expected [bad-interface]"),
        (message("  any a;"), "7:3: error: unknown type p/msg/any; did you mean p/msg/A? [unknown-type]"),
        (message("q::msg::B a;"), "7:1: error: unknown type q/msg/B; did you mean p/msg/A? [unknown-type]"),
        (message("long a; long a;"), "7:14: error: a second field is called `a` [bad-interface]"),
        (message("long a[2][3];"), "7:10: error: `[` stands where `;` is expected [bad-interface]"),
        (message("long a[0];"), "7:8: error: ROS 2 has nothing of at most 0 elements or characters [bad-interface]"),
        (message("string<0> a;"), "7:8: error: ROS 2 has nothing of at most 0 elements or characters [bad-interface]"),
        (message("sequence<sequence<long>> a;"), "7:1: error: a sequence of sequences or arrays, which ROS 2 does not have [bad-interface]"),
        (message("@default (value=300) int8 a;"), "7:17: error: `300` is not a value of int8 [bad-interface]"),
        (message("@default (value=x) string a;"), "7:17: error: `x` is not a value of string [bad-interface]"),
        (message('@default (value="(1, x)") sequence<int8> a;'), '7:17: error: `"(1, x)"` is not a value of int8[] [bad-interface]'),
        (message("long a;", "module A_Constants { const int8 X = 200; };"), "6:33: error: `200` is not a value of int8 [bad-interface]"),
        (message("long a;", "union U switch(long) { case 1: long x; };"), "6:1: error: `union` defines nothing that ROS 2 has; a definition is a module, struct, typedef or const [bad-interface]"),
        (message("E a;", "enum E { X };"), "7:1: error: unknown type p/msg/E; did you mean p/msg/A? [unknown-type]"),
        (message("long a[010];"), "7:8: error: `010` is no decimal number, and ROS 2 reads no other [bad-interface]"),
        (message("@default (value=0x1F) long a;"), "7:17: error: `0x1F` is no decimal number, and ROS 2 reads no other [bad-interface]"),
        (message("long _a;"), "7:6: error: `_a;` is not IDL [bad-interface]"),
        (message(""), "6:8: error: `A` is empty, which no structure of ROS 2 is; write `uint8 structure_needs_at_least_one_member;` [bad-interface]"),
        (message("long a;", "struct A { long b; };\n"), "7:8: error: a second structure is called `A` [bad-interface]"),
        (message("long a;", "struct B { long b; };\n"), "6:8: error: `p::msg::B` is a further structure, and ROS 2 reads a file as one type; define it in a file of its own [bad-interface]"),
        (message("long a;", "module inner { struct A { long b; }; };\n"), "6:23: error: `p::msg::inner::A` is a further structure, and ROS 2 reads a file as one type; define it in a file of its own [bad-interface]"),
        (message("long a;") + " module q { module msg { struct A { long b; }; }; };", "10:33: error: `q::msg::A` is a further structure, and ROS 2 reads a file as one type; define it in a file of its own [bad-interface]"),
        (message("long a; ?"), "7:9: error: `?` is not IDL [bad-interface]"),
        (message("long a;").replace("A {", "B {"), "1:1: error: no struct A is defined in the module p::msg [bad-interface]"),
        ("module p { module msg {", "1:24: error: the end of the file stands where `}` is expected [bad-interface]"),
        ("int32 a\n", "1:1: error: `int32` defines nothing that ROS 2 has; a definition is a module, struct, typedef or const [bad-interface]"),
        ("", "1:1: error: no struct A is defined in the module p::msg [bad-interface]"),
        (message("A a;"), "1:1: error: p/msg/A contains itself [recursive-type]"),
    ],
)  # fmt: skip
def test_a_faulty_definition_is_one_error_at_its_place(
    tmp_path: Path, text: str, finding: str
) -> None:
    types, log = library(tmp_path, A_msg=text)
    types.message("p/A")
    found = str(log.diagnostics[0]).replace(f"{tmp_path}/p/msg/A.idl:", "")
    assert found == finding


@pytest.mark.slow
@pytest.mark.parametrize(
    "text",
    [
        "module a {" * 90_000,
        "@a(" * 250_000,
        message("".join(f"long a{i};" for i in range(60_000))),
        message("sequence<" * 90_000),
        message("a::" * 300_000),
        message("long a;", "".join(f"typedef long T{i};" for i in range(30_000))),
        "/*" * 400_000,
    ],
    ids=itertools.count(),
)
def test_hostile_text_is_read_to_its_end_or_refused(tmp_path: Path, text: str) -> None:
    types, log = library(tmp_path, A_msg=text)
    types.message("p/A")
    assert len(log.diagnostics) <= 1


def test_a_definition_that_another_is_made_of_is_read_once(tmp_path: Path) -> None:
    _, _ = library(tmp_path, A_msg=message("long a;"))
    (tmp_path / "p" / "msg" / "A.msg").write_text("float32 b\n")
    types, log = library(tmp_path)
    assert said(types.message("p/A")) == ["float32 b"]
    assert log.diagnostics == []


@pytest.mark.parametrize(
    ("field", "rules"), [("uint8 a;", []), ("octet a;", ["differing-definition"])]
)
def test_one_in_another_folder_is_compared(tmp_path: Path, field: str, rules: list[str]) -> None:
    library(tmp_path / "idl", A_msg=message(field))
    path = tmp_path / "msg" / "p" / "msg" / "A.msg"
    path.parent.mkdir(parents=True)
    path.write_text("char a\n")
    log = DiagnosticLog()
    InterfaceLibrary.load([tmp_path / "idl", tmp_path / "msg"], log).message("p/A")
    assert [found.rule for found in log.diagnostics] == rules


@pytest.mark.ros2
def test_what_ros_2_makes_of_its_own_definitions_says_what_they_say(tmp_path: Path) -> None:
    share = Path(sys.prefix) / "share"
    found = [
        path
        for path in share.glob("*/*/*.idl")
        if path.with_suffix(f".{path.parent.name}").is_file()
    ]
    for path in found:
        kept = tmp_path / path.relative_to(share)
        kept.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(path, kept)
    log = DiagnosticLog()
    texts, idl = InterfaceLibrary.load([share], log), InterfaceLibrary.load([tmp_path], log)
    for path in found:
        package, kind, stem = path.parts[-3], path.parts[-2], path.stem
        suffixes = {"srv": ("_Request", "_Response"), "action": ("_Goal", "_Result", "_Feedback")}
        for suffix in suffixes.get(kind, ("",)):
            name = f"{package}/{kind}/{stem}{suffix}"
            one, other = texts.structure(name), idl.structure(name)
            assert one is not None
            assert other is not None
            assert said(one) == said(other), name
    assert len(found) > 50
    assert log.diagnostics == []
