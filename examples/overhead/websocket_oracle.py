"""The oracle as ROSMonitoring has it: a process of its own, asked over a WebSocket.

``python -m examples.overhead.websocket_oracle`` says ``{"url": "ws://127.0.0.1:PORT"}``, then answers each
observation (JSON) with ``{"verdict": true}`` or false. What judges is the passive monitor's oracle. A line
on standard input has it begin anew.
"""

from __future__ import annotations

import asyncio
import signal
import sys
import threading
import time

import msgspec

from examples.overhead.middle import PERIOD_S, LocalOracle
from examples.overhead.plant import SYSTEM
from m2c.model import DiagnosticLog, load
from transports.interface import Observation


async def judge(oracle: LocalOracle) -> None:
    """Answer until SIGTERM."""
    from websockets.asyncio.server import ServerConnection, serve

    decode = msgspec.json.Decoder(Observation).decode
    encode = msgspec.json.Encoder().encode

    async def talk(line: ServerConnection) -> None:
        async for text in line:
            await line.send(encode({"verdict": oracle.ask(decode(text))}), text=True)

    ended = asyncio.Event()
    loop = asyncio.get_running_loop()
    loop.add_signal_handler(signal.SIGTERM, ended.set)

    def begin() -> None:
        oracle.begin()
        print('{"began": true}', flush=True)

    def read() -> None:
        for _ in sys.stdin:
            loop.call_soon_threadsafe(begin)

    threading.Thread(target=read, daemon=True).start()
    async with serve(talk, "127.0.0.1", 0, compression=None) as server:
        port = server.sockets[0].getsockname()[1]
        print(f'{{"url": "ws://127.0.0.1:{port}"}}', flush=True)
        while not ended.is_set():
            oracle.advance(time.time_ns())
            try:
                await asyncio.wait_for(ended.wait(), PERIOD_S)
            except TimeoutError:
                continue


def main() -> int:
    """The command."""
    system = load([SYSTEM], DiagnosticLog())
    assert system is not None
    oracle = LocalOracle(system)
    asyncio.run(judge(oracle))
    print(msgspec.json.encode(oracle.standing()).decode(), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
