"""What a process of ``m2c run`` does before it is a node: ``… -m m2c.launch.child PARENT NICE PACKAGE …``.

It has the kernel end it when its parent ends, however that ends (prctl(2)). The parent cannot arrange
that on its own between fork and exec: its threads are not there then, and what they have locked is.

NICE is its priority, a nice value, or empty. Who ends well since a signal asked for that says so by its exit
code. And whoever crashes, or is killed since it does not end, says first where in its code it stood: also
within a middleware that holds Python's lock.
"""

from __future__ import annotations

import ctypes
import faulthandler
import os
import runpy
import signal
import sys

from transports.stop_signals import StopSignals

_PR_SET_PDEATHSIG = 1
SAY_WHERE_AND_END = signal.SIGQUIT
"""What a process is sent that does not end otherwise."""
BY_SIGNAL = 128
"""Plus a signal's number: the exit code of who ended well, as this signal asked for it. Shells have it so."""


def main(arguments: list[str]) -> None:
    """Run ``python -m PACKAGE …`` in this process."""
    parent, nice, package, *_ = arguments
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != int(parent):  # it has ended already
        sys.exit(1)
    faulthandler.enable(all_threads=False)
    faulthandler.register(SAY_WHERE_AND_END, all_threads=False, chain=True)
    if nice:
        _set_priority(int(nice))
    sys.argv[1:] = arguments[3:]
    try:
        runpy.run_module(package, run_name="__main__", alter_sys=True)
    except SystemExit as end:
        if end.code:
            raise
    if number := StopSignals.came():
        sys.exit(BY_SIGNAL + number)


def _set_priority(nice: int) -> None:
    try:
        os.setpriority(os.PRIO_PROCESS, 0, nice)
    except PermissionError:
        sys.exit(
            f"error: priority {nice}: more urgent than usual needs CAP_SYS_NICE, or a limit `nice` that "
            "allows it (limits.conf(5))"
        )


if __name__ == "__main__":
    main(sys.argv[1:])
