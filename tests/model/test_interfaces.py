"""Interface definitions: what is read, from where, and what is said of faulty ones."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from rosbags.typesys import Stores, get_typestore

from m2c.check import check_system
from m2c.language.datatypes import Array, DataType, Primitive, Structure, describe
from m2c.model import DiagnosticLog, InterfaceLibrary, load
from m2c.model.interfaces import canonical, fault_of


def library(
    tmp_path: Path, /, ending: str = "", **files: str
) -> tuple[InterfaceLibrary, DiagnosticLog]:
    """A library of package ``p``; ``Name_msg="…"`` is ``p/msg/Name.msg``, or has another ``ending``."""
    for name, text in files.items():
        stem, _, kind = name.rpartition("_")
        path = tmp_path / "p" / kind / f"{stem}.{ending or kind}"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    log = DiagnosticLog()
    return InterfaceLibrary.load([tmp_path], log), log


def findings(tmp_path: Path, log: DiagnosticLog) -> list[str]:
    return [str(found).replace(f"{tmp_path}/", "") for found in log.diagnostics]


@pytest.mark.parametrize(
    ("written", "kind", "full"),
    [
        ("p/Name", "msg", "p/msg/Name"),
        ("p/Name", "srv", "p/srv/Name"),
        ("p/msg/Name", "srv", "p/msg/Name"),
        ("p::action::Name", "action", "p/action/Name"),
        (" p/Name ", "msg", "p/msg/Name"),
        ("Name", "msg", "Name"),
    ],
)
def test_every_spelling_of_a_type_has_one_name(written: str, kind: str, full: str) -> None:
    assert canonical(written, kind) == full


@pytest.mark.parametrize(
    ("line", "kind"),
    [
        ("int32 a", "int32"),
        ("int32\ta", "int32"),
        ("bool a  # why", "bool"),
        ("string a", "string"),
        ("wstring a", "string"),
        ("string<=5 a", "string"),
        ("string<=5[<=2] a", "string[<=2]"),
        ("float64[] a", "float64[]"),
        ("float64[3] a", "float64[3]"),
        ("float64[<=3] a", "float64[<=3]"),
        ("Other a", "p/msg/Other"),
        ("p/Other[] a", "p/msg/Other[]"),
        ("std_msgs/Header a", "std_msgs/msg/Header"),
        ("geometry_msgs/Point[2] a", "geometry_msgs/msg/Point[2]"),
    ],
)
def test_every_form_of_a_field_is_read(tmp_path: Path, line: str, kind: str) -> None:
    types, log = library(tmp_path, A_msg=f"# first\n\n{line}\n", Other_msg="int8 x\n")
    ((name, found),) = types.message("p/A").fields
    assert (name, describe(found)) == ("a", kind)
    assert log.diagnostics == []


@pytest.mark.parametrize(
    ("line", "value"),
    [
        ("int8 a -5", -5),
        ("uint16 a 0xff", 255),
        ("int8 a 007", 7),
        ("float32 a 1", 1.0),
        ("float64 a -1.5e3", -1500.0),
        ("bool a true", True),
        ("bool a 0", False),
        ('string a "x # y"', "x # y"),
        ("string a 'it is'", "it is"),
        ("string a plain words", "plain words"),
        (r'string a "a\"b"', 'a"b'),
        ("int32[] a [1, 2]", (1, 2)),
        ("int32[] a []", ()),
        ("int32[2] a [1, 2]", (1, 2)),
        ("string[] a ['x, y', \"z\"]", ("x, y", "z")),
        ("bool[<=3] a [true, false]", (True, False)),
    ],
)
def test_a_default_has_the_type_of_its_field(tmp_path: Path, line: str, value: object) -> None:
    types, log = library(tmp_path, A_msg=line)
    assert dict(types.message("p/A").defaults) == {"a": value}
    assert log.diagnostics == []


def test_constants_are_no_fields(tmp_path: Path) -> None:
    types, log = library(tmp_path, A_msg='int8 LOW=-1\nstring NAME="x"\nint32 a\n')
    found = types.message("p/A")
    assert found.constants == (("LOW", "int8", -1), ("NAME", "string", "x"))
    assert [name for name, _ in found.fields] == ["a"]
    assert log.diagnostics == []


def test_services_and_actions_have_their_parts(tmp_path: Path) -> None:
    types, log = library(
        tmp_path, S_srv="int8 a\n---\nint8 b\n", G_action="int8 a\n---\nint8 b\n---\nint8 c\n"
    )
    service, action = types.service("p/S"), types.action("p/G")
    assert (service.request.name, service.response.name) == ("p/srv/S_Request", "p/srv/S_Response")
    parts = (service.request, service.response, action.goal, action.result, action.feedback)
    assert [part.fields[0][0] for part in parts] == ["a", "b", "a", "b", "c"]
    assert "p/srv/S" in types.names("srv")
    assert log.diagnostics == []


def test_the_standard_types_are_there_without_files() -> None:
    types = InterfaceLibrary()
    assert types.message("std_msgs/Int32") == Structure(
        "std_msgs/msg/Int32", (("data", Primitive("int32")),)
    )
    assert types.message("std_msgs/Empty").fields == ()
    assert types.message("std_msgs/Byte").fields == (("data", Primitive("byte")),)
    covariance = dict(types.message("geometry_msgs/PoseWithCovariance").fields)["covariance"]
    assert covariance == Array(Primitive("float64"), 36, True)
    assert dict(types.message("sensor_msgs/BatteryState").fields)["cell_voltage"] == Array(
        Primitive("float32")
    )
    assert [name for name, _ in types.service("std_srvs/SetBool").response.fields] == [
        "success",
        "message",
    ]


def test_the_standard_messages_are_those_of_rosbags() -> None:
    types = InterfaceLibrary()
    for name, (constants, fields) in get_typestore(Stores.ROS2_JAZZY).fielddefs.items():
        found = types.message(name)
        assert found.constants == tuple(constants), name
        assert found.fields == tuple(
            (field, of_rosbags(types, kind))
            for field, kind in fields
            if field != "structure_needs_at_least_one_member"
        ), name


def of_rosbags(types: InterfaceLibrary, kind: Any) -> DataType:
    """The type of a field that rosbags describes by ``kind``."""
    node, argument = kind
    match node.name:
        case "BASE":
            return Primitive("byte" if argument[0] == "octet" else argument[0])
        case "NAME":
            return types.message(argument)
        case "ARRAY":
            return Array(of_rosbags(types, argument[0]), argument[1], True)
        case _:
            return Array(of_rosbags(types, argument[0]), argument[1] or None)


def test_the_examples_of_ros_2_are_known() -> None:
    types = InterfaceLibrary()
    add = types.service("example_interfaces/AddTwoInts")
    assert add.request.fields == (("a", Primitive("int64")), ("b", Primitive("int64")))
    assert add.response.fields == (("sum", Primitive("int64")),)
    fibonacci = types.action("example_interfaces/Fibonacci")
    assert fibonacci.goal.fields == (("order", Primitive("int32")),)
    assert fibonacci.result.fields == (("sequence", Array(Primitive("int32"))),)
    assert fibonacci.feedback.fields == fibonacci.result.fields
    assert types.message("example_interfaces/String") == Structure(
        "example_interfaces/msg/String", (("data", Primitive("string")),)
    )
    layout = types.message("example_interfaces/Int8MultiArray").field("layout")
    assert isinstance(layout, Structure)
    assert layout.name == "example_interfaces/msg/MultiArrayLayout"
    assert [describe(kind) for _, kind in layout.fields] == [
        "example_interfaces/msg/MultiArrayDimension[]",
        "uint32",
    ]
    with pytest.raises(KeyError, match="unknown type example_interfaces/msg/Header"):
        types.message("example_interfaces/Header")


def test_a_definition_of_ones_own_hides_the_standard_one(tmp_path: Path) -> None:
    path = tmp_path / "std_msgs" / "msg" / "Int32.msg"
    path.parent.mkdir(parents=True)
    path.write_text("int32 other\n")
    found = InterfaceLibrary.load([tmp_path], DiagnosticLog()).message("std_msgs/Int32")
    assert found.fields == (("other", Primitive("int32")),)


@pytest.mark.parametrize(
    ("lookup", "name", "message"),
    [
        ("message", "p/Levle", "unknown type p/msg/Levle; did you mean p/msg/Level?"),
        ("message", "std_msgs/Int33", "unknown type std_msgs/msg/Int33; did you mean std_msgs/msg/Int32?"),
        ("message", "Level", "unknown type Level; a type is written pkg/Name"),
        ("message", "a/b/c/d", "unknown type a/b/c/d; a type is written pkg/Name"),
        ("service", "std_srvs/Triger", "unknown type std_srvs/srv/Triger; did you mean std_srvs/srv/Trigger?"),
        ("action", "p/Go", "unknown type p/action/Go"),
        ("service", "p/Level", "p/msg/Level is a message, not a service"),
    ],
)  # fmt: skip
def test_an_unknown_type_comes_with_the_nearest(
    tmp_path: Path, lookup: str, name: str, message: str
) -> None:
    types, _ = library(tmp_path, Level_msg="int8 a\n")
    with pytest.raises(KeyError) as error:
        getattr(types, lookup)(name)
    assert error.value.args[0] == message


LINE = "a line is `type name`, `type name default` or `type NAME=constant`"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("???", f"1:1: error: cannot read `???`; {LINE} [bad-interface]"),
        ("int32", f"1:1: error: cannot read `int32`; {LINE} [bad-interface]"),
        ("\nint32[<=] a", f"2:1: error: cannot read `int32[<=] a`; {LINE} [bad-interface]"),
        ("int32 1a", f"1:1: error: cannot read `int32 1a`; {LINE} [bad-interface]"),
        (f"int32[{'9' * 30}] a", f"1:1: error: cannot read `int32[{'9' * 30}] a`; {LINE} [bad-interface]"),
        ("int32 a five", "1:1: error: `five` is not a value of int32 [bad-interface]"),
        ("int8 a 300", "1:1: error: `300` is not a value of int8 [bad-interface]"),
        ("uint8 a -1", "1:1: error: `-1` is not a value of uint8 [bad-interface]"),
        ("int8 LOW=", "1:1: error: `` is not a value of int8 [bad-interface]"),
        ("bool a maybe", "1:1: error: `maybe` is not a value of bool [bad-interface]"),
        ("string a 'x", "1:1: error: `'x` is not a value of string [bad-interface]"),
        ("int8[2] a [1]", "1:1: error: `[1]` is not a value of int8[2] [bad-interface]"),
        ("int8[] a [1, x]", "1:1: error: `[1, x]` is not a value of int8[] [bad-interface]"),
        ("int8[] a 1", "1:1: error: `1` is not a value of int8[] [bad-interface]"),
        ("int8 a 9**9**9", "1:1: error: `9**9**9` is not a value of int8 [bad-interface]"),
        ("int32 a\nint8 a", "2:1: error: a second field is called `a` [bad-interface]"),
        ("Othr a", "1:1: error: unknown type p/msg/Othr; did you mean p/msg/Other? [unknown-type]"),
        ("A a", "1:1: error: p/msg/A contains itself [recursive-type]"),
    ],
)  # fmt: skip
def test_a_faulty_definition_is_named_with_its_line(
    tmp_path: Path, text: str, message: str
) -> None:
    types, log = library(tmp_path, A_msg=text, Other_msg="int8 x\n")
    types.message("p/A")
    assert findings(tmp_path, log)[0] == f"p/msg/A.msg:{message}"


def test_a_minus_sign_a_hundred_thousand_times_is_no_value(tmp_path: Path) -> None:
    types, log = library(tmp_path, A_msg=f"int8 a {'-' * 100_000}1")
    types.message("p/A")
    assert findings(tmp_path, log) == [
        f"p/msg/A.msg:1:1: error: `{'-' * 80}` is not a value of int8 [bad-interface]"
    ]


def test_a_service_with_too_many_parts_is_an_error(tmp_path: Path) -> None:
    types, log = library(tmp_path, S_srv="---\n---\n")
    types.service("p/S")
    assert findings(tmp_path, log) == [
        "p/srv/S.srv:1:1: error: 3 sections divided by ---; a .srv file has 2 [bad-interface]"
    ]


def test_messages_inside_messages_without_end_are_refused(tmp_path: Path) -> None:
    chain = {f"M{i}_msg": f"M{i + 1} a\n" for i in range(1500)}
    types, log = library(tmp_path, **chain)
    types.message("p/M0")
    assert findings(tmp_path, log)[0] == (
        "p/msg/M32.msg:1:1: error: types are nested more than 32 deep [bad-interface]"
    )


def test_a_definition_of_megabytes_is_refused(tmp_path: Path) -> None:
    types, log = library(tmp_path, A_msg="#" * 2_000_000)
    with pytest.raises(KeyError):
        types.message("p/A")
    assert findings(tmp_path, log) == [
        "p/msg/A.msg:0:0: error: the definition is larger than 1048576 bytes [bad-interface]"
    ]


def test_a_type_is_described_as_people_write_it() -> None:
    kinds: list[DataType] = [
        Primitive("int8"),
        Array(Primitive("int8"), 2, True),
        Structure("", ()),
    ]
    assert [describe(kind) for kind in kinds] == ["int8", "int8[2]", "object"]


@pytest.mark.parametrize(
    ("line", "what"),
    [
        ("int32 Level", "field called `Level`; write `level`"),
        ("int32 a__b", "field called `a__b`; write `a_b`"),
        ("int32 a_", "field called `a_`; write `a`"),
        ("int32 level=1", "constant called `level`; write `LEVEL`"),
        ("int32 A__B=1", "constant called `A__B`; write `A_B`"),
    ],
)
def test_a_member_is_named_as_ros_2_allows_it(tmp_path: Path, line: str, what: str) -> None:
    types, log = library(tmp_path, Level_msg=f"bool ok\n{line}\n")
    types.message("p/Level")
    assert findings(tmp_path, log) == [
        f"p/msg/Level.msg:2:1: error: ROS 2 allows no {what} [bad-interface]"
    ]


@pytest.mark.parametrize("line", ["int32 class", "int32 import", "int32 a1_b2", "int32 A1_B2=3"])
def test_a_member_may_have_any_name_that_ros_2_allows(tmp_path: Path, line: str) -> None:
    types, log = library(tmp_path, Level_msg=f"{line}\n")
    types.message("p/Level")
    assert findings(tmp_path, log) == []


@pytest.mark.parametrize("line", ["int32 ﬁ", "int32 a\u202eb", "ｉｎｔ32 a", 'int32 a"b'])
def test_a_definition_is_written_in_ascii_but_for_its_texts(tmp_path: Path, line: str) -> None:
    types, log = library(tmp_path, Level_msg=f"{line}\n")
    types.message("p/Level")
    (found,) = log.diagnostics
    assert found.rule == "bad-interface"


@pytest.mark.parametrize("package", ["a-b", "A", "a__b", "1a", "a b", 'a"b', "a\nb", "ﬁ"])
def test_a_package_is_named_as_ros_2_allows_it(tmp_path: Path, package: str) -> None:
    path = tmp_path / package / "msg" / "Level.msg"
    path.parent.mkdir(parents=True)
    path.write_text("int32 a\n")
    log = DiagnosticLog()
    InterfaceLibrary.load([tmp_path], log).message(f"{package}/msg/Level")
    (found,) = log.diagnostics
    assert (found.rule, found.position.file) == ("bad-interface", str(path))
    assert found.message == f"ROS 2 allows no package called `{package}`"
    assert found.hint == "lower-case letters, digits and single underscores"


@pytest.mark.parametrize("name", ["level", "Le_vel", "1Level", "Le vel", "Lével"])
def test_a_type_is_named_as_ros_2_allows_it(tmp_path: Path, name: str) -> None:
    path = tmp_path / "p" / "msg" / f"{name}.msg"
    path.parent.mkdir(parents=True)
    path.write_text("int32 a\n")
    log = DiagnosticLog()
    InterfaceLibrary.load([tmp_path], log).message(f"p/{name}")
    (found,) = log.diagnostics
    assert found.message == f"ROS 2 allows no type called `{name}`"


def test_a_part_of_a_service_is_no_message(tmp_path: Path) -> None:
    types, _ = library(tmp_path, Ask_srv="int32 a\n---\n")
    with pytest.raises(KeyError, match="a message type is written like p/msg/Ask_Request"):
        types.message("p/srv/Ask_Request")


def test_a_default_is_made_of_whole_characters(tmp_path: Path) -> None:
    types, log = library(tmp_path, Level_msg='string a "\\ud83d"\n')
    types.message("p/Level")
    assert findings(tmp_path, log) == [
        'p/msg/Level.msg:1:1: error: `"\\ud83d"` is not a value of string [bad-interface]'
    ]


@pytest.mark.parametrize(
    ("written", "value"),
    [
        (r'"a\"#b"  # why', 'a"#b'),
        (r"'a\'#b'", "a'#b"),
        (r'"a\\b"  # "why"', r"a\b"),
        (r'"#"', "#"),
    ],
)
def test_a_text_may_have_quotes_and_what_begins_a_comment(
    tmp_path: Path, written: str, value: str
) -> None:
    types, log = library(tmp_path, Level_msg=f"string a {written}\n")
    assert types.message("p/Level").defaults == (("a", value),)
    assert log.diagnostics == []


def defining(folder: Path, text: str, name: str = "p/msg/Level.msg") -> Path:
    (folder / name).parent.mkdir(parents=True, exist_ok=True)
    (folder / name).write_text(text)
    return folder


def test_a_type_that_two_folders_define_differently_is_of_the_first_and_both_are_named(
    tmp_path: Path,
) -> None:
    log = DiagnosticLog()
    first = defining(tmp_path / "one", "int8 a\n")
    second = defining(tmp_path / "two", "float32 a\n")
    types = InterfaceLibrary.load([first, second], log)
    assert types.message("p/Level").fields == (("a", Primitive("int8")),)
    assert findings(tmp_path, log) == [
        "one/p/msg/Level.msg:0:0: warning: p/msg/Level is defined differently in two/p/msg/Level.msg; "
        "this file is used: its folder comes first [differing-definition]"
    ]


@pytest.mark.parametrize(
    ("name", "one", "two"),
    [
        ("msg/Level.msg", "int8 a", "# of a tank\n\nint8 a  # litres\n"),
        ("msg/Level.msg", "int8 a 007\r\n", "int8  a 7"),
        ("srv/Fill.srv", "int8 a\n---", "int8 a\n---\n# nothing\n"),
        ("action/Go.action", "---\n---\nint8 a", "---\n---\nint8 a\n"),
    ],
)
def test_definitions_that_say_the_same_are_one(
    tmp_path: Path, name: str, one: str, two: str
) -> None:
    log = DiagnosticLog()
    folders = [defining(tmp_path / n, text, f"p/{name}") for n, text in (("1", one), ("2", two))]
    types = InterfaceLibrary.load(folders, log)
    kind, stem = name.split("/")
    find = {"msg": types.message, "srv": types.service, "action": types.action}[kind]
    find(f"p/{stem.partition('.')[0]}")
    assert log.diagnostics == []


@pytest.mark.parametrize(
    "other",
    ["int8 a 1\n", "int8 a\nint8 b\n", "int16 a\n", "int8 b\n", "int8 a\nint8 B=1\n", "", "???"],
)
def test_a_definition_that_says_anything_else_differs(tmp_path: Path, other: str) -> None:
    log = DiagnosticLog()
    folders = [defining(tmp_path / "1", "int8 a\n"), defining(tmp_path / "2", other)]
    InterfaceLibrary.load(folders, log).message("p/Level")
    (found,) = log.diagnostics
    assert found.rule == "differing-definition"


def test_a_copy_in_one_folder_is_told_as_one_in_another(tmp_path: Path) -> None:
    log = DiagnosticLog()
    defining(tmp_path / "a", "int8 a\n")
    defining(tmp_path / "b", "int16 a\n")
    found = InterfaceLibrary.load([tmp_path], log).message("p/Level")
    assert found.fields == (("a", Primitive("int8")),)
    assert [found.rule for found in log.diagnostics] == ["differing-definition"]


def test_what_is_named_comes_before_what_is_beside_the_system(tmp_path: Path) -> None:
    beside = defining(tmp_path / "interfaces", "int8 beside\n")
    of_system = defining(tmp_path / "of_system", "int8 of_system\n")
    named = defining(tmp_path / "named", "int8 named\n")
    for name in ("m.scxml", "n.scxml"):
        (tmp_path / name).write_text(
            f'<scxml xmlns="http://www.w3.org/2005/07/scxml" name="{name[0]}" initial="a">'
            '<datamodel><data id="level" type="p/Level"/></datamodel><state id="a"/></scxml>'
        )
    (tmp_path / "system.xml").write_text(
        '<roaml><node_models><input type="node-ascxml" src="m.scxml"/></node_models>'
        '<interfaces><input type="ros-interfaces" src="of_system"/></interfaces></roaml>'
    )

    def field_of(*paths: str, interfaces: tuple[Path, ...] = ()) -> str:
        system = load([tmp_path / path for path in paths], DiagnosticLog(), interfaces)
        assert system is not None
        ((name, _),) = system.library.message("p/Level").fields
        return name

    assert field_of("m.scxml") == "beside"
    assert field_of("m.scxml", "n.scxml", interfaces=(named,)) == "named"
    assert field_of("system.xml") == "of_system"
    assert field_of("system.xml", interfaces=(named,)) == "named"
    assert field_of("system.xml", interfaces=(beside, named)) == "beside"
    assert of_system.is_dir()


@pytest.mark.parametrize(
    ("kind", "written", "said"),
    [
        ("action", "p/srv/Ask", "p/srv/Ask is a service, not an action"),
        ("action", "p/Place", "p/msg/Place is a message, not an action"),
        ("action", "std_msgs/msg/String", "std_msgs/msg/String is a message, not an action"),
        ("service", "p/action/Go", "p/action/Go is an action, not a service"),
        ("service", "p::msg::Place", "p/msg/Place is a message, not a service"),
        ("service", "p/Go", "p/action/Go is an action, not a service"),
        ("message", "p/action/Go", "p/action/Go is an action, not a message"),
        ("message", "p/Ask", "p/srv/Ask is a service, not a message"),
        ("message", "std_srvs/srv/Trigger", "std_srvs/srv/Trigger is a service, not a message"),
    ],
)
def test_a_type_of_another_kind_is_told_as_that(
    tmp_path: Path, kind: str, written: str, said: str
) -> None:
    for name, text in (
        ("msg/Place.msg", ""),
        ("srv/Ask.srv", "---\n"),
        ("action/Go.action", "---\n---\n"),
    ):
        (tmp_path / "p" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "p" / name).write_text(text)
    library = InterfaceLibrary.load([tmp_path], DiagnosticLog())
    with pytest.raises(KeyError) as error:
        getattr(library, kind)(written)
    assert fault_of(error.value)[0] == said
    assert fault_of(error.value)[1].startswith(f"the type of a{'n' * (kind == 'action')} {kind} is")


MODEL = '<scxml initial="s" name="m">{}<state id="s"/></scxml>'
OF_KIND = {
    "p/msg/A.msg": ("bad x\n", '<ros_topic_publisher topic="/a" type="p/A"/>'),
    "p/srv/A.srv": ("bad x\n---\n", '<ros_service_server service_name="/a" type="p/A"/>'),
    "p/action/A.action": ("---\n---\nbad x\n", '<ros_action_server action_name="/a" type="p/A"/>'),
    "p/msg/A.idl": ("module p { bad", '<ros_topic_publisher topic="/a" type="p/A"/>'),
}


@pytest.mark.parametrize("file", OF_KIND)
@pytest.mark.parametrize(
    ("current", "model", "folder"),
    [
        ("w", "m.scxml", "interfaces"),
        ("w", "models/../m.scxml", "interfaces"),
        ("w/models", "../m.scxml", "../interfaces"),
        (".", "w/m.scxml", "w/interfaces"),
        ("w", "{}/w/m.scxml", "{}/w/interfaces"),
    ],
)
def test_a_definition_is_named_from_where_the_model_is_named(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    file: str,
    current: str,
    model: str,
    folder: str,
) -> None:
    text, declared = OF_KIND[file]
    (tmp_path / "w" / "models").mkdir(parents=True)
    definition = tmp_path / "w" / "interfaces" / file
    definition.parent.mkdir(parents=True)
    definition.write_text(text)
    (tmp_path / "w" / "m.scxml").write_text(MODEL.format(declared))
    monkeypatch.chdir(tmp_path / current)
    log = DiagnosticLog()
    read = load([Path(model.format(tmp_path))], log)
    assert read is not None
    check_system(read, log)
    named = {found.position.file for found in log.diagnostics} - {str(Path(model.format(tmp_path)))}
    assert named == {f"{folder.format(tmp_path)}/{file}"}


@pytest.mark.parametrize(
    ("written", "meant"),
    [("int33", "int32"), ("strng", "string"), ("unit8", "uint8"), ("flaot64", "float64")],
)
def test_a_misspelt_primitive_type_is_told(tmp_path: Path, written: str, meant: str) -> None:
    types, log = library(tmp_path, A_msg=f"{written} x\n", Int3_msg="int8 x\n")
    types.message("p/A")
    (found,) = findings(tmp_path, log)
    assert f"unknown type {written}; did you mean {meant}?" in found
