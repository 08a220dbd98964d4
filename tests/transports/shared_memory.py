"""What Fast DDS leaves in shared memory."""

from __future__ import annotations

import re
from pathlib import Path

SHARED = Path("/dev/shm")
_PORT = re.compile(r"(?:sem\.)?fastrtps_port(\d+)")
_FIRST_PORT, _PORTS = 7400, 250
"""Ports of domain 0, and how many each domain has (DDSI-RTPS 2.5, 9.6.2.3)."""


def unused() -> set[str]:
    """Files of Fast DDS that no process has mapped or open."""
    files = {path.name for path in SHARED.glob("*fastrtps*")}
    for process in Path("/proc").glob("[0-9]*"):
        try:
            text = (process / "maps").read_text()
            text += "".join(str(item.readlink()) for item in (process / "fd").iterdir())
        except OSError:  # it has ended meanwhile, or is not ours
            continue
        files = {name for name in files if f"{SHARED}/{name}" not in text}
    return {name for name in files if (SHARED / name).exists()}


def of_domain(number: int) -> set[str]:
    """Those of :func:`unused` that belong to a ROS domain: mailboxes of its participants.

    The others, in which messages stand, do not tell whose they are.
    """
    first = _FIRST_PORT + _PORTS * number
    found = set()
    for name in unused():
        match = _PORT.match(name)
        if match is not None and first <= int(match[1]) < first + _PORTS:
            found.add(name)
    return found
