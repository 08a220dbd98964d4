"""Processors that do not sleep while something is measured.

A tick goes from process to process, some 28 times, and each time the next one's processor may have to be
woken. How long that takes is not the system's nor the monitor's: a virtual machine's processor is handed back
to its host, which decides by itself how soon, so that a tick's length comes and goes by a half for minutes.
``cyclictest`` of the rt-tests holds processors awake for the same reason and in the same way.
"""

from __future__ import annotations

import contextlib
import struct
from collections.abc import Iterator
from pathlib import Path

LATENCY = Path("/dev/cpu_dma_latency")
"""Whoever has it open bounds how long a processor may take to wake up (µs, a signed 32-bit number): Linux,
Documentation/power/pm_qos_interface.rst. Root may, as a rule."""


@contextlib.contextmanager
def held_awake(wanted: bool = True, device: Path = LATENCY) -> Iterator[bool]:
    """No processor sleeps deeper than a loop until the end of the block.

    Args:
        wanted: False leaves them as they are.
        device: where that is asked for.

    Yields:
        Whether it is so: not where the system does not permit it, or does not have it.
    """
    with contextlib.ExitStack() as stack:
        is_awake = False
        if wanted:
            with contextlib.suppress(OSError):
                file = stack.enter_context(device.open("r+b", buffering=0))
                file.write(struct.pack("i", 0))
                is_awake = True
        yield is_awake
