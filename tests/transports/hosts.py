"""Two hosts: network namespaces of this machine with a cable between them. Only root may have them."""

from __future__ import annotations

import contextlib
import os
import subprocess
from collections.abc import Iterator

ADDRESSES = ("10.77.0.1", "10.77.0.2")
"""Of the first host and of the second one, on the cable."""


def may_be_made() -> bool:
    """Whether this user, on this machine, may have two hosts."""
    try:
        with two_hosts():
            return True
    except (OSError, subprocess.CalledProcessError, AssertionError):
        return False


@contextlib.contextmanager
def two_hosts() -> Iterator[tuple[list[str], list[str]]]:
    """The beginning of a command line for each: what follows runs on that host."""
    with _host() as first, _host() as second:
        names = [f"cable{first}", f"cable{second}"]
        _ip(first, "link", "add", names[0], "type", "veth", "peer", names[1], "netns", str(second))
        for host, name, address in zip((first, second), names, ADDRESSES, strict=True):
            _ip(host, "link", "set", "lo", "up")
            _ip(host, "addr", "add", f"{address}/24", "dev", name)
            _ip(host, "link", "set", name, "up")
        yield _inside(first), _inside(second)


@contextlib.contextmanager
def _host() -> Iterator[int]:
    """The process that keeps the namespace."""
    keeper = subprocess.Popen(
        ["unshare", "--net", "--", "sh", "-c", "echo apart; read _ || true"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    )
    with keeper:
        assert keeper.stdin is not None
        assert keeper.stdout is not None
        assert keeper.stdout.readline() == b"apart\n"
        assert os.readlink(f"/proc/{keeper.pid}/ns/net") != os.readlink("/proc/self/ns/net")
        yield keeper.pid


def plug(host: list[str], is_in: bool) -> None:
    """Pull the cable between the two hosts out, or plug it in again.

    Args:
        host: one of them, as ``two_hosts`` gives it.
        is_in: whether it is to be in.
    """
    keeper = int(host[host.index("--target") + 1])
    _ip(keeper, "link", "set", f"cable{keeper}", "up" if is_in else "down")


def _inside(host: int) -> list[str]:
    return ["nsenter", "--target", str(host), "--net", "--"]


def _ip(host: int, *arguments: str) -> None:
    subprocess.run([*_inside(host), "ip", *arguments], check=True, capture_output=True)
