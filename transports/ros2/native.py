"""What rcl and rmw know and rclpy 7 (Jazzy) does not hand out: graph events, publishers' GIDs,
subscriptions that are made while the interpreter goes on, and what has arrived.

rclpy gives the address of each rcl object (``handle.pointer``); the C functions called here are
part of rcl's and rmw's public API. Being told of arrivals is what may be missing: ``tells_of_arrivals``
asks for it, and wait sets are the other way. For GIDs and graph events rclpy has none.
The structs are those of Jazzy's ``rmw/types.h``, ``rcl/subscription.h`` and
``rcutils/types/uint8_array.h``.
"""

from __future__ import annotations

import ctypes
import os
import platform
import struct
from collections.abc import Sequence
from typing import Any

import msgspec
from rclpy.utilities import get_rmw_implementation_identifier

from transports.interface import TransportError

GID_BYTES = 16
"""RMW_GID_STORAGE_SIZE."""
PREFIX_BYTES = 12
"""The part of a DDS GUID that names the participant: one per rclpy context."""

_RCL_RET_OK = 0
_FIRST_BUFFER = 1024


def gid_of(endpoint: Any) -> bytes:
    """The GID of an endpoint that the graph shows (``rclpy.topic_endpoint_info``), as messages have it."""
    return bytes(endpoint.endpoint_gid[:GID_BYTES])


def participant_of(gid: Sequence[int]) -> bytes:
    """What an endpoint's GID says of its participant (DDSI-RTPS 2.5, 9.3.1)."""
    return bytes(gid[:PREFIX_BYTES])


class _Allocator(ctypes.Structure):
    _fields_ = (
        ("allocate", ctypes.c_void_p),
        ("deallocate", ctypes.c_void_p),
        ("reallocate", ctypes.c_void_p),
        ("zero_allocate", ctypes.c_void_p),
        ("state", ctypes.c_void_p),
    )


class _Bytes(ctypes.Structure):
    _fields_ = (
        ("buffer", ctypes.c_void_p),
        ("length", ctypes.c_size_t),
        ("capacity", ctypes.c_size_t),
        ("allocator", _Allocator),
    )


class _Gid(ctypes.Structure):
    _fields_ = (
        ("implementation", ctypes.c_char_p),
        ("data", ctypes.c_uint8 * GID_BYTES),
    )


class _MessageInfo(ctypes.Structure):
    _fields_ = (
        ("source_timestamp", ctypes.c_int64),
        ("received_timestamp", ctypes.c_int64),
        ("publication_sequence_number", ctypes.c_uint64),
        ("reception_sequence_number", ctypes.c_uint64),
        ("publisher_gid", _Gid),
        ("from_intra_process", ctypes.c_bool),
    )


class _Duration(ctypes.Structure):
    _fields_ = (("sec", ctypes.c_uint64), ("nsec", ctypes.c_uint64))


class _Qos(ctypes.Structure):
    _fields_ = (
        ("history", ctypes.c_int),
        ("depth", ctypes.c_size_t),
        ("reliability", ctypes.c_int),
        ("durability", ctypes.c_int),
        ("deadline", _Duration),
        ("lifespan", _Duration),
        ("liveliness", ctypes.c_int),
        ("liveliness_lease_duration", _Duration),
        ("avoid_ros_namespace_conventions", ctypes.c_bool),
    )


class _RmwSubscriptionOptions(ctypes.Structure):
    _fields_ = (
        ("payload", ctypes.c_void_p),
        ("ignore_local_publications", ctypes.c_bool),
        ("require_unique_network_flow_endpoints", ctypes.c_int),
        ("content_filter_options", ctypes.c_void_p),
    )


class _SubscriptionOptions(ctypes.Structure):
    _fields_ = (
        ("qos", _Qos),
        ("allocator", _Allocator),
        ("rmw", _RmwSubscriptionOptions),
        ("disable_loaned_message", ctypes.c_bool),
    )


class _ErrorText(ctypes.Structure):
    _fields_ = (("text", ctypes.c_char * 1024),)


_place_of = struct.Struct("PN").unpack_from
"""Of ``_Bytes``: address and length, in a third of the time that ctypes takes field by field."""
_UNTIL_GID = _MessageInfo.publisher_gid.offset + _Gid.data.offset - struct.calcsize("qqQ")
_info_of = struct.Struct(f"qqQ{_UNTIL_GID}x{GID_BYTES}s").unpack_from
"""Of ``_MessageInfo``, what ``Taken`` has of it."""


class Taken(msgspec.Struct, frozen=True):
    """A serialized message and where it comes from.

    Attributes:
        payload: the message as CDR.
        source_ns, received_ns: when it was written, and when it arrived here.
        number: of the publication, from 1 per publisher; 0 where the RMW does not count.
        gid: the publisher's.
    """

    payload: bytes
    source_ns: int
    received_ns: int
    number: int
    gid: bytes


def _library(name: str | None) -> Any:
    """A library by its name; None: what the process has loaded, the C library among it."""
    try:
        return ctypes.CDLL(name)  # loaded by rclpy already: found by its soname
    except OSError as error:
        raise TransportError(f"cannot load ROS 2's {name}: {error}") from error


_KINDS = (("subscription", "message"), ("service", "request"), ("client", "response"))
"""Of what can ring a bell, and at what."""


class Libraries:
    """The functions, with their types."""

    def __init__(self) -> None:
        rcl = _library("librcl.so")
        rmw = _library(f"lib{get_rmw_implementation_identifier()}.so")
        utils = _library("librcutils.so")
        pointer, size = ctypes.c_void_p, ctypes.c_size_t
        self.graph_guard = self._declare(rcl, "rcl_node_get_graph_guard_condition", pointer)
        self.add_guard = self._declare(rcl, "rcl_wait_set_add_guard_condition")
        self.add_subscription = self._declare(rcl, "rcl_wait_set_add_subscription")
        self.add_subscription.argtypes = [pointer, pointer, pointer]
        self.take = self._declare(rcl, "rcl_take_serialized_message")
        self.client_handle = self._declare(rcl, "rcl_client_get_rmw_handle", pointer)
        self.publisher_handle = self._declare(rcl, "rcl_publisher_get_rmw_handle", pointer)
        self.gid_of_client = self._declare(rmw, "rmw_get_gid_for_client")
        self.gid_of_publisher = self._declare(rmw, "rmw_get_gid_for_publisher")
        self.on_new = {
            kind: self._declare(rcl, name)
            for kind, what in _KINDS
            if hasattr(rcl, name := f"rcl_{kind}_set_on_new_{what}_callback")
        }
        ring = getattr(_library(None), "eventfd_write", None)
        self.ring = None if ring is None else ctypes.cast(ring, pointer)
        self.bytes_init = self._declare(utils, "rcutils_uint8_array_init")
        self.bytes_fini = self._declare(utils, "rcutils_uint8_array_fini")
        self.default_allocator = self._declare(utils, "rcutils_get_default_allocator", _Allocator)
        self.reset_error = self._declare(utils, "rcutils_reset_error", None)
        self.error_text = self._declare(utils, "rcutils_get_error_string", _ErrorText)
        self.subscribe = self._declare(rcl, "rcl_subscription_init")
        self.unsubscribe = self._declare(rcl, "rcl_subscription_fini")
        self.subscription_options = self._declare(
            rcl, "rcl_subscription_get_default_options", _SubscriptionOptions
        )
        self.subscribe.argtypes = [pointer, pointer, pointer, ctypes.c_char_p, pointer]
        self.unsubscribe.argtypes = [pointer, pointer]
        self.take_request = self._declare(rcl, "rcl_take_request")
        self.take_request.argtypes = [pointer, pointer, pointer]
        self.send_response = self._declare(rcl, "rcl_send_response")
        self.send_response.argtypes = [pointer, pointer, pointer]
        self.graph_guard.argtypes = [pointer]
        self.add_guard.argtypes = [pointer, pointer, pointer]
        self.take.argtypes = [pointer, pointer, pointer, pointer]
        for handle in (self.client_handle, self.publisher_handle):
            handle.argtypes = [pointer]
        for gid in (self.gid_of_client, self.gid_of_publisher):
            gid.argtypes = [pointer, pointer]
        for function in self.on_new.values():
            function.argtypes = [pointer, pointer, pointer]
        self.bytes_init.argtypes = [pointer, size, pointer]
        self.bytes_fini.argtypes = [pointer]

    def why(self) -> str:
        """What rcl says of the last error on this thread, which is forgotten then."""
        text: str = self.error_text().text.decode(errors="replace")
        self.reset_error()
        return " ".join(text.split()).rpartition(", at /")[0] or text

    @staticmethod
    def _declare(library: Any, name: str, result: Any = ctypes.c_int) -> Any:
        function = getattr(library, name, None)
        if function is None:
            raise TransportError(
                f"this ROS 2 has no {name}; the transport needs the C API of Jazzy"
            )
        function.restype = result
        return function


_libraries: Libraries | None = None


def functions() -> Libraries:
    """rcl's, rmw's and rcutils' functions; rclpy must be loaded."""
    global _libraries  # noqa: PLW0603 - rclpy must be loaded first
    if _libraries is None:
        _libraries = Libraries()
    return _libraries


_capsule_pointer = ctypes.pythonapi.PyCapsule_GetPointer
_capsule_pointer.restype = ctypes.c_void_p
_capsule_pointer.argtypes = [ctypes.py_object, ctypes.c_char_p]


def address_in(capsule: Any) -> int:
    """What a capsule of a generated message class holds (``_TYPE_SUPPORT`` and its like: without a name)."""
    return int(_capsule_pointer(capsule, None))


def graph_guard(node: Any) -> int:
    """The address of the guard condition that is triggered by every change of the graph.

    Args:
        node: an ``rclpy.node.Node``.
    """
    address = functions().graph_guard(node.handle.pointer)
    if not address:
        raise TransportError("this ROS 2 gives no graph events")
    return int(address)


def add_guard(wait_set: Any, guard: int) -> None:
    """Have ``wait_set`` (of rclpy) wait for the guard condition at ``guard`` as well."""
    if functions().add_guard(wait_set.pointer, guard, None) != _RCL_RET_OK:
        functions().reset_error()
        raise TransportError("cannot wait for graph events")


def add_subscription(wait_set: Any, address: int) -> int:
    """Have ``wait_set`` (of rclpy) wait for the ``rcl_subscription_t`` at ``address`` as well.

    Returns:
        Its place among the set's subscriptions.
    """
    rcl, place = functions(), ctypes.c_size_t()
    if rcl.add_subscription(wait_set.pointer, address, ctypes.byref(place)) != _RCL_RET_OK:
        raise TransportError(f"cannot wait for messages: {rcl.why()}")
    return place.value


_TWO_REGISTERS = ("x86_64", "aarch64")
"""Machines that pass a pointer and a size as they pass a file's number and a count to add."""


def tells_of_arrivals(node: Any) -> bool:
    """Whether ``ring_for`` works here: on this machine, with this rcl and this RMW.

    Args:
        node: an ``rclpy.node.Node``; its services, which all nodes have, are asked to ring no bell.
    """
    services = tuple(node.services)
    if not (hasattr(os, "eventfd") and platform.machine() in _TWO_REGISTERS and services):
        return False
    rcl = functions()
    if rcl.ring is None or len(rcl.on_new) < len(_KINDS):
        return False
    try:
        with services[0].handle:
            ring_for("service", services[0].handle, None)
    except TransportError:
        return False
    return True


def ring_for(kind: str, handle: Any, bell: int | None) -> None:
    """Have rcl write to a file at each arrival, at once if there is something already.

    Args:
        kind: of the entity: ``subscription``, ``service`` or ``client``.
        handle: its handle, in use.
        bell: an eventfd; None: no longer.

    Raises:
        TransportError: this RMW does not report arrivals.
    """
    rcl = functions()
    set_callback = rcl.on_new[kind]
    code = (
        set_callback(handle.pointer, None, None)
        if bell is None
        else set_callback(handle.pointer, rcl.ring, bell)
    )
    if code != _RCL_RET_OK:
        rcl.reset_error()
        raise TransportError(
            f"{get_rmw_implementation_identifier()} does not tell when something arrives"
        )


def make_subscription(address: int, node: Any, ros: Any, topic: str, profile: Any) -> None:
    """Subscribe to ``topic``, without holding the interpreter.

    Args:
        address: of an ``rcl_subscription_t`` that is zero; it is filled.
        node: an ``rclpy.node.Node``.
        ros: class of the messages, its type support loaded.
        topic: full name.
        profile: an ``rclpy.qos.QoSProfile``: history, depth, reliability and durability count.

    Raises:
        TransportError: rcl refuses; the text says why.
    """
    rcl = functions()
    options = rcl.subscription_options()
    options.qos.history, options.qos.depth = int(profile.history), profile.depth
    options.qos.reliability = int(profile.reliability)
    options.qos.durability = int(profile.durability)
    support = address_in(type(ros)._TYPE_SUPPORT)
    code = rcl.subscribe(
        address, node.handle.pointer, support, topic.encode(), ctypes.byref(options)
    )
    if code != _RCL_RET_OK:
        raise TransportError(rcl.why())


def end_subscription(address: int, node: Any) -> None:
    """End what ``make_subscription`` began."""
    rcl = functions()
    if rcl.unsubscribe(address, node.handle.pointer) != _RCL_RET_OK:
        rcl.reset_error()


def gid_of_client(handle: Any) -> bytes:
    """The GID by which the events of a service's client (``client.handle``) name it."""
    rcl = functions()
    return _gid_of(rcl.client_handle(handle.pointer), rcl.gid_of_client, "a service client")


def gid_of_publisher(handle: Any) -> bytes:
    """The GID of a publisher (``publisher.handle``), as messages have it."""
    rcl = functions()
    return _gid_of(rcl.publisher_handle(handle.pointer), rcl.gid_of_publisher, "a publisher")


def _gid_of(entity: int | None, ask: Any, what: str) -> bytes:
    gid = _Gid()
    if not entity or ask(entity, ctypes.byref(gid)) != _RCL_RET_OK:
        functions().reset_error()
        raise TransportError(f"cannot tell the GID of {what}")
    return bytes(gid.data)


class Taker:
    """Takes serialized messages with their publishers' GIDs; one thread at a time."""

    def __init__(self) -> None:
        rcl = functions()
        self._functions = rcl
        self._allocator = rcl.default_allocator()
        self._bytes = _Bytes()
        self._info = _MessageInfo()
        if rcl.bytes_init(ctypes.byref(self._bytes), _FIRST_BUFFER, ctypes.byref(self._allocator)):
            raise TransportError("no memory for messages")
        self._take = rcl.take
        self._arguments = (ctypes.byref(self._bytes), ctypes.byref(self._info), None)

    def take(self, handle: Any) -> Taken | None:
        """The next message of a subscription (``subscription.handle``), None if there is none."""
        if self._take(handle.pointer, *self._arguments) != _RCL_RET_OK:
            self._functions.reset_error()
            return None
        payload = ctypes.string_at(*_place_of(self._bytes))
        return Taken(payload, *_info_of(self._info))

    def close(self) -> None:
        """Give the buffer back; idempotent."""
        self._functions.bytes_fini(ctypes.byref(self._bytes))
