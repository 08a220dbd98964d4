"""What a process of ``m2c run`` does before it is a node: ``python -m m2c.launch.child PARENT PACKAGE …``.

It has the kernel end it when its parent ends, however that ends (prctl(2)). The parent cannot arrange
that on its own between fork and exec: its threads are not there then, and what they have locked is.

And whoever crashes, or is killed since it does not end, says first where in its code it stood: also within
a middleware that holds Python's lock.
"""

from __future__ import annotations

import ctypes
import faulthandler
import os
import runpy
import signal
import sys

_PR_SET_PDEATHSIG = 1
SAY_WHERE_AND_END = signal.SIGQUIT
"""What a process is sent that does not end otherwise."""


def main(arguments: list[str]) -> None:
    """Run ``python -m PACKAGE …`` in this process."""
    parent, package, *_ = arguments
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != int(parent):  # it has ended already
        sys.exit(1)
    faulthandler.enable(all_threads=False)
    faulthandler.register(SAY_WHERE_AND_END, all_threads=False, chain=True)
    sys.argv[1:] = arguments[2:]
    runpy.run_module(package, run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    main(sys.argv[1:])
