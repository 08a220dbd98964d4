"""Builds of Fast DDS that hang as a participant ends: the one place that calls C++ by name (decision 19).

As rmw destroys a participant it takes its listener away, and Fast DDS 2 waits for a callback that is under
way until ``steady_clock::time_point::max()``. libstdc++ waits by ``pthread_cond_clockwait`` for a time of
that clock. Built for a glibc older than 2.30, which has none (the wheels are: manylinux_2_28), it converts
that time to the system's clock instead, which overflows: it asks again at once, for ever, with the lock in
hand that the callback needs. With a limit nothing overflows, but only C++ can set one: neither rmw's C API
nor an option of Fast DDS does.
"""

from __future__ import annotations

import ctypes
import functools
from pathlib import Path
from typing import Any

from transports.ros2 import native

_PARTICIPANT_OF = "_ZN16rmw_fastrtps_cpp22get_domain_participantEP10rmw_node_s"
"""``rmw_fastrtps_cpp::get_domain_participant(rmw_node_t *)``, which is public."""
_SET_LISTENER = (
    "_ZN8eprosima7fastdds3dds17DomainParticipant12set_listenerEPNS1_25DomainParticipantListenerE"
    "NSt6chrono8durationIlSt5ratioILl1ELl1EEEE"
)
"""``DomainParticipant::set_listener(DomainParticipantListener *, std::chrono::seconds)`` of Fast DDS 2."""
_CALLBACK_S = 2
"""What a callback of Fast DDS at most takes on a busy machine."""
_MAPPED_PATH = 5
"""Which field of a line of ``/proc/self/maps`` is the file's path (proc(5))."""
_LIBRARY = "/libfastrtps.so"
"""Fast DDS 2's; that of 3, which has other symbols, has another name."""


@functools.cache
def may_hang() -> bool:
    """Whether this process has loaded a Fast DDS 2 that cannot wait by the steady clock.

    Where it can, as on the Ubuntu that Jazzy is made for, no C++ is called.
    """
    maps = Path("/proc/self/maps").read_text(encoding="utf-8", errors="surrogateescape")
    for line in maps.splitlines():
        if _LIBRARY in line:
            path = line.split(maxsplit=_MAPPED_PATH)[_MAPPED_PATH]
            try:
                return b"pthread_cond_clockwait" not in Path(path).read_bytes()
            except OSError:  # it was exchanged meanwhile
                return True
    return False


def end_discovery(node: Any) -> None:
    """Before ``node`` is destroyed: its context no longer learns who comes and goes, if that might hang.

    Args:
        node: an ``rclpy.node.Node`` in a context of its own.
    """
    if not may_hang():
        return
    rmw = native.functions().rmw
    participant_of = getattr(rmw, _PARTICIPANT_OF, None)
    set_listener = getattr(rmw, _SET_LISTENER, None)
    if participant_of is None or set_listener is None:
        return
    participant_of.restype = ctypes.c_void_p
    participant_of.argtypes = [ctypes.c_void_p]
    set_listener.argtypes = [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int64]
    participant = participant_of(native.functions().node_handle(node.handle.pointer))
    if participant:
        set_listener(participant, None, _CALLBACK_S)
