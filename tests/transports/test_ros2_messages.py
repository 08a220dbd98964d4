"""Messages both ways between our structs and rclpy's classes, through CDR as on the wire."""

from __future__ import annotations

import importlib
import re
from typing import Any

import msgspec
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from m2c.diagnostics import DiagnosticLog
from m2c.language.datatypes import INTEGER_RANGES, Array, DataType, Primitive, Structure
from m2c.model.interfaces import InterfaceLibrary
from m2c.runtime.messages import message_class
from tests.transports import ros2_network
from transports.interface import TransportError
from transports.service_events import REQUEST_RECEIVED, REQUEST_SENT

pytestmark = pytest.mark.ros2

PACKAGES = (
    *("action_msgs", "builtin_interfaces", "diagnostic_msgs", "geometry_msgs", "rosgraph_msgs"),
    *("std_msgs", "unique_identifier_msgs"),
)
LIBRARY = InterfaceLibrary.load([ros2_network.HERE / "ros2_interfaces"], DiagnosticLog())


def standard_types() -> list[str]:
    """Every message of the standard packages that are installed and that m2c knows."""
    found = []
    for package in PACKAGES:
        module = importlib.import_module(f"{package}.msg")
        for name in sorted(vars(module)):
            if re.fullmatch(r"[A-Z]\w*", name):
                found.append(f"{package}/msg/{name}")
    return found


TYPES = standard_types()
TEXT = st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=8)


def values(kind: DataType, name: str = "") -> st.SearchStrategy[Any]:
    """Values of ``kind``; a field called short_… has strings of at most four bytes."""
    match kind:
        case Primitive("bool"):
            return st.booleans()
        case Primitive("string" | "wstring"):
            return st.text("abc~", max_size=4) if "short" in name else TEXT
        case Primitive("float32"):
            return st.floats(width=32)
        case Primitive("float64"):
            return st.floats()
        case Primitive(other):
            return st.integers(*INTEGER_RANGES[other])
        case Array(element, length, fixed):
            least, most = (length or 0) if fixed else 0, 4 if length is None else length
            return st.lists(values(element, name), min_size=least, max_size=most)
        case Structure():
            cls = message_class(kind)
            return st.builds(cls, **{field: values(inner, field) for field, inner in kind.fields})


def through_cdr(type_name: str, message: Any) -> tuple[Any, Any]:
    """What a receiver makes of ``message``: our struct, and plain values."""
    from rclpy.serialization import deserialize_message, serialize_message

    from transports.ros2 import cdr
    from transports.ros2.messages import Codec, plain_of

    codec = Codec(type_name, type(message))
    sent = serialize_message(codec.encode(message))
    received = deserialize_message(sent, codec.ros)
    assert repr(cdr.reader(codec.ros)(sent)) == repr(plain_of(received))
    return codec.decode(received), plain_of(received)


def as_text(message: Any) -> str:
    """For comparison: NaN equals NaN, -0.0 is not 0.0."""
    return repr(msgspec.to_builtins(message))


@pytest.mark.parametrize("type_name", TYPES)
@settings(max_examples=40, deadline=None)
@given(data=st.data())
def test_every_standard_message_comes_back_as_it_left(type_name: str, data: st.DataObject) -> None:
    message = data.draw(values(LIBRARY.message(type_name)))
    struct, plain = through_cdr(type_name, message)
    assert type(struct) is type(message)
    assert as_text(struct) == as_text(message)
    assert repr(plain) == as_text(message)


@settings(max_examples=300, deadline=None)
@given(data=st.data())
def test_bytes_that_are_no_message_are_an_error_and_nothing_else(data: st.DataObject) -> None:
    from rclpy.serialization import serialize_message

    from transports.ros2 import cdr
    from transports.ros2.messages import Codec

    type_name = data.draw(st.sampled_from(TYPES))
    message = data.draw(values(LIBRARY.message(type_name)))
    codec = Codec(type_name, type(message))
    sent = bytearray(serialize_message(codec.encode(message)))
    for place, byte in data.draw(
        st.lists(st.tuples(st.integers(4, len(sent) - 1), st.integers(0, 255)))
    ):
        sent[place] = byte
    cut = bytes(sent[: data.draw(st.integers(0, len(sent)))])
    try:
        read = cdr.reader(codec.ros)(b"\x00\x01\x00\x00" + cut[4:])
    except cdr.CdrError:
        return
    assert set(read) == set(codec.ros.get_fields_and_field_types())


@pytest.fixture(scope="module")
def everything() -> type[msgspec.Struct]:
    """A class with every kind of field, loaded into this process."""
    ros2_network.load(ros2_network.built())
    return message_class(LIBRARY.message("conformance/msg/Everything"))


@settings(max_examples=150, deadline=None, suppress_health_check=list(HealthCheck))
@given(data=st.data())
def test_every_kind_of_field_comes_back_as_it_left(
    everything: type[msgspec.Struct], data: st.DataObject
) -> None:
    message = data.draw(values(LIBRARY.message("conformance/msg/Everything")))
    struct, plain = through_cdr("conformance/msg/Everything", message)
    assert as_text(struct) == as_text(message)
    assert repr(plain) == as_text(message)


SERVICES = ("Describe", "Double")


@pytest.mark.parametrize("service", SERVICES)
@pytest.mark.parametrize("which", ["request", "response"])
@settings(max_examples=150, deadline=None, suppress_health_check=list(HealthCheck))
@given(data=st.data())
def test_an_event_of_a_service_is_what_rclpy_would_make_of_it(
    everything: type[msgspec.Struct], service: str, which: str, data: st.DataObject
) -> None:
    from rclpy.serialization import deserialize_message, serialize_message

    from transports.ros2 import cdr, event_cdr
    from transports.ros2.event_cdr import former
    from transports.ros2.interfaces import ros_class
    from transports.ros2.messages import Codec, plain_of

    type_name = f"conformance/srv/{service}"
    kind = getattr(LIBRARY.service(type_name), which)
    message = data.draw(values(kind))
    part = Codec(f"{type_name}_{which.capitalize()}", type(message))
    event = ros_class(f"{type_name}_Event")
    number, call = data.draw(st.integers(0, 3)), data.draw(st.integers(0, 2**63 - 1))
    gid = data.draw(st.binary(min_size=16, max_size=16))
    encoded = part.encode(message)
    formed = former(event, part.ros, which)(number, 1_700_000_001_000_000_002, gid, call, encoded)
    sent = formed if isinstance(formed, bytes) else serialize_message(formed)
    expected = event()
    expected.info.event_type, expected.info.sequence_number = number, call
    expected.info.stamp.sec, expected.info.stamp.nanosec = 1_700_000_001, 2
    expected.info.client_gid = list(gid)
    setattr(expected, which, [encoded])
    received = deserialize_message(sent, event)
    assert repr(plain_of(received)) == repr(plain_of(expected))
    assert repr(cdr.reader(event)(sent)) == repr(plain_of(expected))
    is_request = number in (REQUEST_SENT, REQUEST_RECEIVED)
    read = event_cdr.reader(event)(sent)
    assert (read.event_type, read.stamp_ns, read.gid) == (number, 1_700_000_001_000_000_002, gid)
    assert read.call == call
    contents = plain_of(encoded) if is_request == (which == "request") else None
    assert repr(read.contents) == repr(contents)


@settings(max_examples=300, deadline=None, suppress_health_check=list(HealthCheck))
@given(data=st.data())
def test_bytes_that_are_no_event_are_an_error_and_nothing_else(
    everything: type[msgspec.Struct], data: st.DataObject
) -> None:
    from rclpy.serialization import serialize_message

    from transports.ros2 import cdr, event_cdr
    from transports.ros2.interfaces import ros_class

    event = ros_class(f"conformance/srv/{data.draw(st.sampled_from(SERVICES))}_Event")
    part = data.draw(st.sampled_from(["request", "response"]))
    whole = event()
    setattr(
        whole, part, [ros_class(f"conformance/srv/{event.__name__[:-6]}_{part.capitalize()}")()]
    )
    whole.info.event_type = data.draw(st.integers(0, 5))
    sent = bytearray(serialize_message(whole))
    for place, byte in data.draw(
        st.lists(st.tuples(st.integers(4, len(sent) - 1), st.integers(0, 255)))
    ):
        sent[place] = byte
    cut = bytes(sent[: data.draw(st.integers(4, len(sent)))])
    try:
        read = event_cdr.reader(event)(cut)
    except cdr.CdrError:
        return
    assert 0 <= read.event_type < 256
    assert len(read.gid) == 16


@pytest.mark.parametrize(
    ("service", "which", "made"),
    [
        ("Describe", "request", "request"),
        ("Describe", "response", "_whole"),  # wide strings
        ("Double", "request", "_whole"),  # eight bytes
        ("Double", "response", "response"),
    ],
)
def test_an_event_is_made_from_its_parts_where_these_can_move(
    everything: type[msgspec.Struct], service: str, which: str, made: str
) -> None:
    from transports.ros2.event_cdr import former
    from transports.ros2.interfaces import ros_class

    event = ros_class(f"conformance/srv/{service}_Event")
    formed = former(event, ros_class(f"conformance/srv/{service}_{which.capitalize()}"), which)
    assert getattr(formed, "func", formed).__name__ == made


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"u64": 2**64}, ".u64: 18446744073709551616 does not fit in uint64"),
        ({"u64": -1}, ".u64: -1 does not fit in uint64"),
        ({"i8": 1.5}, ".i8: 1.5 is not an integer"),
        ({"octet": 256}, ".octet: 256 does not fit in uint8"),
        ({"truth": 1}, ".truth: 1 is not a boolean"),
        ({"f32": 1e39}, ".f32: 1e+39 does not fit in a float32"),
        ({"f64": "1"}, ".f64: '1' is not a number"),
        ({"text": 5}, ".text: 5 is not a string"),
        ({"text": "a\0b"}, ".text: a string of ROS 2 cannot hold the character NUL"),
        ({"text": "\ud800"}, r".text: '\ud800' is not Unicode text"),
        ({"short_text": "sechs!"}, ".short_text: a string of length 6; at most 5 fits"),
        ({"wide_texts": [None]}, ".wide_texts[0]: None is not a string"),
        ({"four_bytes": [1, 2]}, ".four_bytes: 2 elements; expected 4"),
        ({"few_doubles": [0.0] * 4}, ".few_doubles: 4 elements; expected at most 3"),
        ({"integers": [1, -1]}, ".integers[1]: -1 does not fit in uint64"),
        ({"doubles": 1.0}, ".doubles: 1.0 is not a list"),
        ({"truths": [True, 0]}, ".truths[1]: 0 is not a boolean"),
        ({"nested": None}, ".nested: expected a message, got None"),
        ({"numbers": [None]}, ".numbers[0]: expected a message, got None"),
    ],
    ids=str,
)
def test_what_does_not_fit_is_refused_with_its_place(
    everything: type[msgspec.Struct], fields: dict[str, Any], said: str
) -> None:
    from transports.ros2.messages import Codec

    codec = Codec("conformance/msg/Everything", everything)
    with pytest.raises(TransportError) as refused:
        codec.encode(everything(**fields))
    assert str(refused.value) == f"conformance/msg/Everything{said}"


def test_bytes_are_a_list_of_small_numbers(everything: type[msgspec.Struct]) -> None:
    from transports.ros2.messages import Codec

    codec = Codec("conformance/msg/Everything", everything)
    encoded = codec.encode(everything(integers=b"\x01\x02", doubles=b"\x03"))
    assert (list(encoded.integers), list(encoded.doubles)) == ([1, 2], [3.0])


def test_integral_floats_are_integers() -> None:
    """ECMAScript has one kind of number: a model's 3 may be 3.0."""
    from transports.ros2.messages import Codec

    message = message_class(LIBRARY.message("std_msgs/msg/Int32"))
    assert Codec("std_msgs/msg/Int32", message).encode(message(data=3.0)).data == 3


def test_fields_that_are_not_those_of_the_installed_package_are_refused() -> None:
    from transports.ros2.messages import Codec

    class Int32(msgspec.Struct):
        __type_name__ = "std_msgs/msg/Int32"
        value: int = 0

    with pytest.raises(TransportError, match=r"fields are value, .* installed data"):
        Codec("std_msgs/msg/Int32", Int32)


@pytest.mark.parametrize(
    ("type_name", "said"),
    [
        ("no_such_interfaces/msg/Door", "`no_such_interfaces`.*m2c interfaces build"),
        ("std_msgs/msg/Int33", "`std_msgs` that is installed has no type `std_msgs/msg/Int33`"),
        ("std_msgs/Int32", "expected <package>/<msg|srv|action>/<Name>".replace("|", r"\|")),
        ("", "is no ROS 2 type"),
    ],
)
def test_a_type_that_is_not_there_is_named_with_how_to_get_it(type_name: str, said: str) -> None:
    from transports.ros2.interfaces import ros_class

    with pytest.raises(TransportError, match=said):
        ros_class(type_name)


def test_of_what_is_not_read_only_the_beginning_is_made() -> None:
    from rclpy.serialization import serialize_message

    from transports.ros2 import cdr
    from transports.ros2.interfaces import ros_class

    ros = ros_class("std_msgs/msg/UInt8MultiArray")
    payload = serialize_message(ros(data=bytes(1000)))
    assert len(cdr.reader(ros, frozenset({("data",)}))(payload)["data"]) == 1000
    made = cdr.reader(ros, frozenset({("layout", "data_offset")}))(payload)
    assert made == cdr.reader(ros)(payload) | {"data": [0] * 256}
