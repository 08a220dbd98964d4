"""A Zenoh router as a process: ``python -m transports.zenoh_link.router --listen ENDPOINT``.

What its clients publish, call and announce it passes on to the others that want it. It is Zenoh's own, within
this process; ``zenohd`` need not be installed.
"""

# zenoh's stubs leave the results of some methods open
# mypy: disable-error-code="no-untyped-call"

from __future__ import annotations

import argparse
import contextlib
import logging
import sys
from collections.abc import Sequence

from transports.interface import TransportError
from transports.stop_signals import StopSignals
from transports.work_queue import WorkQueue
from transports.zenoh_link.log import LOG
from transports.zenoh_link.session import ROUTER, open_session


def main(arguments: Sequence[str] | None = None) -> int:
    """Pass on until SIGINT or SIGTERM; the exit code: 0 then, 2 if it cannot listen."""
    parser = argparse.ArgumentParser(
        prog="python -m transports.zenoh_link.router",
        description="Run a Zenoh router.",
        epilog="example: --listen tcp/127.0.0.1:7447",
    )
    parser.add_argument("--listen", required=True, metavar="ENDPOINT", help="where clients meet it")
    parser.add_argument("--zenoh-config", default="", help="a Zenoh configuration file (JSON5)")
    parser.add_argument(
        "--secure", default="", metavar="DIR", help="the certificates of `moon keys init`"
    )
    parser.add_argument(
        "--ready-fd", type=int, metavar="FD", help="write a line to this open file once it listens"
    )
    chosen = parser.parse_args(arguments)
    logging.basicConfig(level=logging.INFO, format="%(levelname)s %(name)s: %(message)s")
    options = {
        "mode": ROUTER,
        "listen": chosen.listen,
        "config": chosen.zenoh_config,
        "secure": chosen.secure,
        "identity": ROUTER,
    }
    signals = StopSignals()
    try:
        session = open_session(options)
    except TransportError as error:
        LOG.error("%s", error)
        return 2
    LOG.info("a router listens at %s", chosen.listen)
    if chosen.ready_fd is not None:
        with contextlib.suppress(BrokenPipeError), open(chosen.ready_fd, "wb") as ready:
            ready.write(b"\n")
    ended: WorkQueue[None] = WorkQueue()  # a signal's handler may put into it
    signals.call(lambda: ended.put(None))
    ended.get()
    session.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
