"""Requests taken and answered by rcl's own functions, so that who asks is known.

rclpy takes a request's ``rmw_request_id_t`` and shows of it the number, but not ``writer_guid``: who sent
it. rcl hands out both (``rcl_take_request``). What it reads into and writes from are rosidl's C structs; the
functions that make, convert and free them are those that rclpy has from each generated Python class.
"""

from __future__ import annotations

import ctypes
import threading
from collections.abc import Callable
from typing import Any

import msgspec

from transports.interface import TransportError
from transports.ros2 import native

_RET_OK = 0
_RET_TIMEOUT = 2
_RET_TAKE_FAILED = 601


class RequestId(msgspec.Struct, frozen=True):
    """Which call of whose.

    Attributes:
        gid: of the client, as this end knows it.
        call: its number among the client's calls.
    """

    gid: bytes
    call: int


class _RequestId(ctypes.Structure):
    """``rmw_request_id_t``."""

    _fields_ = (
        ("writer_guid", ctypes.c_uint8 * native.GID_BYTES),
        ("sequence_number", ctypes.c_int64),
    )


_pointer = ctypes.c_void_p
# called with the interpreter held, and what they raise is raised
_Create = ctypes.PYFUNCTYPE(_pointer)
_Destroy = ctypes.PYFUNCTYPE(None, _pointer)
_ToPython = ctypes.PYFUNCTYPE(ctypes.py_object, _pointer)
_FromPython = ctypes.PYFUNCTYPE(ctypes.c_bool, ctypes.py_object, _pointer)


class _Form:
    """rosidl's C struct of one message type.

    Args:
        ros: rclpy's class of it, its type support loaded.
    """

    def __init__(self, ros: Any) -> None:
        support = type(ros)
        self._create = _Create(native.address_in(support._CREATE_ROS_MESSAGE))
        self.free: Callable[[int], None] = _Destroy(native.address_in(support._DESTROY_ROS_MESSAGE))
        self.read: Callable[[int], Any] = _ToPython(native.address_in(support._CONVERT_TO_PY))
        self.write: Callable[[Any, int], bool] = _FromPython(
            native.address_in(support._CONVERT_FROM_PY)
        )

    def make(self) -> int:
        """An empty one, to be freed."""
        address = self._create()
        if not address:
            raise TransportError("no memory for messages")
        return int(address)


class Requests:
    """The requests of one service.

    Args:
        handle: the service's (``service.handle``).
        request, response: rclpy's classes of the messages, their type support loaded.
    """

    def __init__(self, handle: Any, request: Any, response: Any) -> None:
        self._handle = handle
        self._lock = threading.RLock()
        """rcl has a service used by one thread at a time; a signal's handler may answer while its own thread
        does."""
        self._request = _Form(request)
        self._response = _Form(response)
        self._functions = native.functions()

    def take(self) -> tuple[RequestId, Any] | None:
        """The next request, as a message of rclpy's, and whose it is; None if there is none.

        Raises:
            TransportError: it cannot be read; it is gone.
            InvalidHandle: the service is destroyed.
        """
        found = _RequestId()
        message = self._request.make()
        try:
            with self._lock, self._handle:
                code = self._functions.take_request(
                    self._handle.pointer, ctypes.byref(found), message
                )
            if code == _RET_TAKE_FAILED:
                self._functions.reset_error()
                return None
            if code != _RET_OK:
                raise TransportError(f"service failed to take request: {self._functions.why()}")
            id_ = RequestId(bytes(found.writer_guid), found.sequence_number)
            return id_, self._request.read(message)
        finally:
            self._request.free(message)

    def answer(self, request: RequestId, response: Any) -> None:
        """Send ``response`` (a message of rclpy's); from any thread. Who asked may be gone.

        Raises:
            TransportError: rcl refuses; the text says why.
            InvalidHandle: the service is destroyed.
        """
        to = _RequestId((ctypes.c_uint8 * native.GID_BYTES)(*request.gid), request.call)
        message = self._response.make()
        try:
            self._response.write(response, message)
            with self._lock, self._handle:
                code = self._functions.send_response(
                    self._handle.pointer, ctypes.byref(to), message
                )
        finally:
            self._response.free(message)
        if code == _RET_TIMEOUT:  # the client's reader has left, or is not known yet
            self._functions.reset_error()
        elif code != _RET_OK:
            raise TransportError(self._functions.why())
