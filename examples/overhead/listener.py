"""A tap as its own process, which only counts: how much it heard, and how late.

``python -m examples.overhead.listener --transport zenoh --endpoint ENDPOINT --link NODE …``. Says that it is
ready once it is linked to all nodes; answers each line on standard input with what it heard since the
last.
"""

from __future__ import annotations

import argparse
import os
import signal
import sys
import threading
from collections.abc import Sequence

import msgspec

from benchmarks.sampling import quantile
from transports.interface import Observation
from transports.registry import connect

LOOK_S = 0.05


def main(arguments: Sequence[str] | None = None) -> int:
    """Listen until SIGTERM or the end of standard input."""
    parser = argparse.ArgumentParser(description="Tap everything, and count.")
    parser.add_argument("--transport", default="zenoh")
    parser.add_argument("--endpoint", default="")
    parser.add_argument("--link", action="append", default=[], metavar="NODE")
    chosen = parser.parse_args(arguments)
    options = {"endpoint": chosen.endpoint} if chosen.endpoint else {}
    transport = connect(chosen.transport, f"listener_{os.getpid()}", options)
    signal.signal(signal.SIGTERM, lambda *_: transport.post(transport.close))
    lags: list[float] = []

    def hear(seen: Observation) -> None:
        lags.append((seen.received_ns - seen.stamp_ns) / 1e6)

    tap = transport.tap([], hear)
    ready = False

    def look() -> None:
        nonlocal ready
        if not ready and set(chosen.link) <= set(tap.peers()):
            ready = True
            print('{"ready": true}', flush=True)

    def report() -> None:
        nonlocal lags
        taken, lags = lags, []
        said = {
            "heard": len(taken),
            "lag_p50_ms": quantile(taken, 0.5),
            "lag_p99_ms": quantile(taken, 0.99),
            "problems": list(tap.problems()),
        }
        print(msgspec.json.encode(said).decode(), flush=True)

    def read() -> None:
        for _ in sys.stdin:
            transport.post(report)

    transport.every(LOOK_S, look)
    threading.Thread(target=read, daemon=True).start()
    transport.spin()
    transport.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
