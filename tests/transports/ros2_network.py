"""Real ROS 2 nodes for tests: the suite's interface package, and a domain of one's own."""

from __future__ import annotations

import ctypes
import itertools
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import msgspec
import pytest

from m2c.model import builtin
from m2c.rosidl.build import InterfaceInstall, build_interfaces
from tests.transports import shared_memory
from transports.interface import Connection
from transports.networks import ThreadedNetwork

HERE = Path(__file__).parent
BUILD = HERE.parent.parent / "build" / "test-interfaces"
SITE = f"lib/python{sys.version_info.major}.{sys.version_info.minor}/site-packages"


def built() -> InterfaceInstall:
    """The interface packages of the tests, built once for all runs."""
    return build_interfaces([HERE / "ros2_interfaces"], BUILD)


def have_ticks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have ``bt_interfaces`` installed, as where its setup script was sourced: what is built, is built without it."""
    ticks = msgspec.structs.replace(built(), packages=(builtin.PACKAGE,))
    for name, value in ticks.environment().items():
        monkeypatch.setenv(name, value)


def load(install: InterfaceInstall) -> None:
    """Make the packages importable here: a process that runs looks for no new library folders."""
    for package in install.packages:
        root = install.prefix / package
        if str(root / SITE) in sys.path:
            continue
        sys.path.append(str(root / SITE))
        libraries = sorted((root / "lib").glob("lib*.so"))
        while libraries:  # in whatever order they need one another
            left = [library for library in libraries if not _loads(library)]
            assert len(left) < len(libraries), f"cannot load {left}"
            libraries = left


def _loads(library: Path) -> bool:
    try:
        ctypes.CDLL(str(library), mode=ctypes.RTLD_GLOBAL)
    except OSError:
        return False
    return True


@contextmanager
def own_domain() -> Iterator[int]:
    """A ROS domain that no other test uses, on loopback only, and in which nobody is left of an earlier one."""
    from domain_coordinator import domain_id

    own = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    before = shared_memory.unused()
    with domain_id(_next_domain) as number:
        own["ROS_DOMAIN_ID"] = str(number)
        outside = {name: os.environ.get(name) for name in own}
        os.environ.update(own)
        try:
            yield number
        finally:
            shared_memory.remove_mailboxes(shared_memory.ports_of(number), before)
            for (
                name,
                value,
            ) in outside.items():  # who has no domain of his own does not take this one
                os.environ.pop(name) if value is None else os.environ.update({name: value})


_numbers = itertools.count(os.getpid())


def _next_domain() -> int:
    """One of 1 to 100 in which no participant has a port at the moment."""
    bound = _bound_ports()
    domains = (number % 100 + 1 for number in itertools.islice(_numbers, 100))
    return next(each for each in domains if bound.isdisjoint(shared_memory.ports_of(each)))


def _bound_ports() -> set[int]:
    """The UDP ports that somebody has (proc_net_udp(5)): of each line, the local address in hexadecimal digits."""
    lines = Path("/proc/net/udp").read_text().splitlines()[1:]
    return {int(line.split()[1].rpartition(":")[2], 16) for line in lines}


def network() -> ThreadedNetwork:
    """Nodes in this process's domain."""
    from transports.ros2 import connect

    def join(name: str, others: Sequence[Connection]) -> Connection:
        return connect(name, {})

    return ThreadedNetwork(join)


Connect = Callable[[str], Connection]
