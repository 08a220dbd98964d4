"""What ROS 2's own reader of definitions refuses, m2c refuses too."""

from __future__ import annotations

import itertools
from pathlib import Path

import pytest

from m2c.model import DiagnosticLog, InterfaceLibrary
from m2c.model.types import type_of_text

_TYPES = [
    "bool",
    "byte",
    "char",
    "int8",
    "uint64",
    "float32",
    "float64",
    "string",
    "wstring",
    "string<=5",
    "wstring<=5",
    "Other",
    "p/Other",
    "p/msg/Other",
    "std_msgs/String",
    "std_msgs/msg/String",
    "time",
    "duration",
    "int",
    "double",
    "boolean",
    "octet",
    "wchar",
    "string<=0",
    "string<=",
    "string<5",
    "int8<=5",
    "string<=-1",
    "string<=05",
    "Other<=2",
]
_ARRAYS = (
    "",
    "[]",
    "[3]",
    "[<=3]",
    "[0]",
    "[<=0]",
    "[-1]",
    "[03]",
    "[3][3]",
    "[ 3]",
    "[3",
    "[<3]",
    "[<=]",
)
_VALUED = [
    "bool",
    "int8",
    "uint8",
    "float64",
    "string",
    "wstring",
    "string<=5",
    "Other",
    "Other[]",
    "int8[]",
    "int8[2]",
    "int8[<=2]",
    "bool[]",
    "float64[]",
    "string[]",
    "string<=5[]",
    "string<=5[<=2]",
]
_VALUES = (
    *("1", "-1", "256", "0x10", "017", "1.5", "1.", "true", "TRUE", "yes", "x", "1 2", "- 1", "0xg", "é"),
    *("'x'", '"x"', "''", '"a\\"b"', "\"a\"b\"", "x'", "abcdef", '"abcdef"', "a=b", "'a=b'", "日本"),
    *("\\n", '"\\n"', '"\\r"', '"a\\\\"', '"\\q"', '"\\x1"', '"\\N{BULLET}"', '"\\x0a"', "\\u12", '"\\t"'),
    *("[1]", "[1,2]", "[1,2,]", "[1, 2, ]", "[1, 2, 3]", "[1,,2]", "[]", "[ ]", "[,]", "[ 1 ]", "[1 2]"),
    *("['a']", "['a',]", "['a', ]", "[a,b]", "['a, b', c]", "[abcdef]", "['abcdef']", "[true,false]", "[1.5]"),
    *("(1,2)", "[1", "1]", "[[1]]"),
)  # fmt: skip
_LINES = (
    *("int8 a", "int8\ta", "int8  a   5", " int8 a", "\tint8 a", "int8 a#b", "int8", "int8 a =", "int8 A =1"),
    *("int8 A = 1", "int8 a_", "int8 A_=1", "int8 _a", "int8 1a", "int8 aB", "int8 a-b", "int8 a;", "int8 a,b"),
    *("int8[] a[]", "int8 a[3]", "int8 [] a", "string <=5 a", "int8 a\nint8 a", "int8 A=1\nint8 A=2"),
    *("other a", "P/Other a", "p//Other a", "/Other a", "p::msg::Other a", "p.Other a", "---", "\ufeffint8 a"),
    *("int8\u00a0a", "int8 a\u00a05", "int8 a\x0cint8 b", "int8 a\r\nint8 b", "int8 a\n  # b\n", "int8 class"),
)  # fmt: skip
_RULES = ("---", "--- ", " ---", "----", "---#", "---\r")


def _messages() -> list[str]:
    typed = [f"{kind}{array} a" for kind, array in itertools.product(_TYPES, _ARRAYS)]
    pairs = list(itertools.product(_VALUED, _VALUES))
    return [*typed, *(f"{k} a {v}" for k, v in pairs), *(f"{k} A={v}" for k, v in pairs), *_LINES]


def _divided() -> list[str]:
    rules = [()] + [r for n in (1, 2, 3) for r in itertools.product(_RULES[: 7 - n], repeat=n)]
    return ["int8 a\n" + "".join(f"{rule}\nint8 b{i}\n" for i, rule in enumerate(r)) for r in rules]


def _is_refused(folder: Path, kind: str, text: str) -> bool:
    path = folder / "p" / kind / f"A.{kind}"
    path.write_bytes(text.encode())
    log = DiagnosticLog()
    types = InterfaceLibrary.load([folder], log)
    {"msg": types.message, "srv": types.service, "action": types.action}[kind]("p/A")
    return log.has_errors


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for kind in ("msg", "srv", "action"):
        (tmp_path / "p" / kind).mkdir(parents=True)
    (tmp_path / "p" / "msg" / "Other.msg").write_text("int8 x\n")
    return tmp_path


def _ros_2_refuses(kind: str, text: str) -> bool:
    """Whether ROS 2 makes no types of ``text``: it makes IDL of it, which it reads in its turn."""
    from lark.exceptions import LarkError
    from rosidl_adapter import msg, parser
    from rosidl_parser.parser import parse_idl_string

    read = {
        "msg": parser.parse_message_string,
        "srv": parser.parse_service_string,
        "action": parser.parse_action_string,
    }[kind]
    wrong = (  # what ROS 2's own parsers raise: their errors, and whatever they run into
        *(parser.InvalidSpecification, parser.InvalidValue, LarkError, IndexError, KeyError),
        *(NameError, NotImplementedError, TypeError, ValueError),
    )
    try:
        found = read("p", "A", text)
        for item in (*found.fields, *found.constants) if kind == "msg" else ():
            value = item.default_value if item in found.fields else item.value
            of = msg.get_idl_type(item.type)
            if isinstance(value, str):
                literal = msg.to_idl_literal(of, value).encode("latin-1").decode("latin-1")
                given = f"@default (value={literal})".replace("\r", "\n")
                parse_idl_string(
                    f"module p {{ module msg {{ struct A {{ {given} long a; }}; }}; }};"
                )
    except wrong:
        return True
    return False


@pytest.mark.ros2
@pytest.mark.slow
def test_no_message_is_taken_that_ros_2_refuses(
    folder: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    taken = [text for text in _messages() if not _is_refused(folder, "msg", text)]
    assert len(taken) > 300
    assert [text for text in taken if _ros_2_refuses("msg", text)] == []


@pytest.mark.ros2
@pytest.mark.parametrize("kind", ["srv", "action"])
def test_no_service_or_action_is_taken_that_ros_2_refuses(
    folder: Path, capfd: pytest.CaptureFixture[str], kind: str
) -> None:
    refused = {text: _is_refused(folder, kind, text) for text in _divided()}
    assert refused == {text: _ros_2_refuses(kind, text) for text in refused}


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("string<=5 s \"abcdef\"", '1: `"abcdef"` is longer than string<=5 allows'),
        ("string<=2[] s ['ab', 'abc']", "1: `['ab', 'abc']` is longer than string<=2[] allows"),
        ("int32[0] a", "1: ROS 2 has no array of 0 elements; the size of an array is 1 or more; `[]` is any"),
        ("int32[<=0] a", "1: ROS 2 has no array of at most 0 elements; the size of an array is 1 or more; `[]` is any"),
        ("int8[] A=[1]", "1: a constant cannot be of type int8[]; its type is a primitive without bounds"),
        ("string<=5 A='x'", "1: a constant cannot be of type string<=5; its type is a primitive without bounds"),
        ("int8[] a [1,2,]", "1: `[1,2,]` is not a value of int8[]"),
        ("string<=0 a", "1: ROS 2 has no type `string<=0`; a string may have a bound, from 1: string<=5"),
        ("int8<=5 a", "1: ROS 2 has no type `int8<=5`; a string may have a bound, from 1: string<=5"),
        ("std_msgs/msg/Bool a", "1: `std_msgs/msg/Bool` has more than a package and a name, which ROS 2 does not take; write `std_msgs/Bool`"),
        ("  int8 a", "3: white space stands before `int8`, which ROS 2 does not take; begin the line with the type"),
        ("int8 a;", "1: `;` is not a value of int8"),
        ("string a b=c", "1: ROS 2 takes `a b=c` for a constant: it has a `=`; a default value has none"),
        ("int8[] a[]", "1: cannot read `int8[] a[]`; a line is `type name`, `type name default` or `type NAME=constant`"),
    ],
)  # fmt: skip
def test_what_ros_2_refuses_is_told(folder: Path, line: str, message: str) -> None:
    (folder / "p" / "msg" / "A.msg").write_text(f"{line}\n")
    log = DiagnosticLog()
    InterfaceLibrary.load([folder], log).message("p/A")
    (found,) = log.diagnostics
    hint = f"; {found.hint}" if found.hint else ""
    assert (found.rule, f"{found.position.column}: {found.message}{hint}") == (
        "bad-interface",
        message,
    )


@pytest.mark.parametrize(
    ("kind", "text", "message"),
    [
        ("srv", "int8 a\n", "1: no line `---` divides it; a .srv file has 2 sections: request, response, with `---` between them"),
        ("action", "", "1: no line `---` divides it; a .action file has 3 sections: goal, result, feedback, with `---` between them"),
        ("action", "---\n", "1: 2 sections divided by ---; a .action file has 3 sections: goal, result, feedback, with `---` between them"),
        ("srv", "int8 a\n--- \n", "2: white space stands beside `---`, which ROS 2 does not take"),
    ],
)  # fmt: skip
def test_a_definition_has_all_its_sections(
    folder: Path, kind: str, text: str, message: str
) -> None:
    (folder / "p" / kind / f"A.{kind}").write_text(text)
    log = DiagnosticLog()
    types = InterfaceLibrary.load([folder], log)
    (types.service if kind == "srv" else types.action)("p/A")
    (found,) = log.diagnostics
    hint = f"; {found.hint}" if found.hint else ""
    assert f"{found.position.line}: {found.message}{hint}" == message


@pytest.mark.parametrize(
    ("written", "right"),
    [
        ("time", "builtin_interfaces/Time"),
        ("duration", "builtin_interfaces/Duration"),
        ("int", "int32"),
        ("long", "int32"),
        ("double", "float64"),
        ("float", "float32"),
        ("boolean", "bool"),
        ("Header", "std_msgs/Header"),
    ],
)
def test_a_type_of_another_language_comes_with_what_ros_2_calls_it(
    folder: Path, written: str, right: str
) -> None:
    (folder / "p" / "msg" / "A.msg").write_text(f"{written}[] a\n")
    log = DiagnosticLog()
    InterfaceLibrary.load([folder], log).message("p/A")
    (found,) = log.diagnostics
    assert (found.rule, found.message) == ("unknown-type", f"unknown type {written}")
    assert found.hint == f"did you mean {right}?"


@pytest.mark.parametrize(
    ("written", "right"),
    [
        ("int", "int32"),
        ("double", "float64"),
        ("boolean", "bool"),
        ("time", "builtin_interfaces/Time"),
    ],
)
@pytest.mark.parametrize("array", ["", "[]", "[3]"])
def test_the_type_of_a_variable_comes_with_what_ros_2_calls_it(
    written: str, right: str, array: str
) -> None:
    found = type_of_text(f"{written}{array}", InterfaceLibrary())
    assert found == f"did you mean {right}?"
