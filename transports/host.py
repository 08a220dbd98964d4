"""Which host this process runs on: processes of one host read one time of day."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from transports.interface import HERE

_BOOT_ID = Path("/proc/sys/kernel/random/boot_id")


def _boot_id() -> str:
    try:
        return _BOOT_ID.read_text(encoding="ascii").strip().replace("-", "")
    except OSError:
        return ""


def clock_of(host: str) -> str:
    """See ``TellsClocks.clock_of``: of who says that it is on ``host`` (:data:`ID`); "": it does not say."""
    return HERE if host and host == ID else host


ID: Final = _boot_id()
"""Of a running kernel (random(4)), 32 hexadecimal digits; "" where there is none. Containers on one kernel
share its time of day: a time namespace has other clocks of its own, not this one (time_namespaces(7)).
"""
