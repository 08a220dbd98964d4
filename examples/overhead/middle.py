"""The paper's way: a monitor in the middle of each call, which forwards what its oracle has judged.

Two processes, :func:`stand` and, where the oracle is asked over a WebSocket, :func:`judge_over_websocket`. A
line on standard input has the oracle begin anew.

As MOON and ROSMonitoring have it: the monitor serves ``/name_mon``; it asks the oracle about the request,
waits for the verdict, calls ``/name``, asks about the response, waits again, and answers. It stands on
both sides of each monitored skill: between the policy and its tick, and between the skill and what it
calls. Topics are only listened to.

It is written to be fast: one process for all services, no call blocks another while it is forwarded,
the same oracle as the passive monitor's (the paper's runs on a Java virtual machine), no compression and
no logging. With ``in-process`` even the WebSocket is left out, which neither MOON nor ROSMonitoring does.
"""

from __future__ import annotations

import asyncio
import itertools
import signal
import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import msgspec

from benchmarks.processes import say, spin_until_ended
from examples.overhead.plant import read_system
from examples.overhead.routes import MONITORED, rerouted
from m2c.model.interfaces import InterfaceLibrary
from m2c.model.machine import Interface, InterfaceKind, Machine
from m2c.model.system import System
from m2c.runtime.messages import message_class
from moon.monitor.models import ModelMonitor
from moon.verdict import Outcome
from transports.interface import (
    CallOutcome,
    CallResult,
    Observation,
    ObservationKind,
    Request,
    Service,
    Topic,
    Transport,
)
from transports.registry import connect

PERIOD_S = 0.01
"""Time passes for the oracle this often, as in ``moon monitor``."""
NODE = "man_in_the_middle"

_KINDS = {
    InterfaceKind.SERVER: (ObservationKind.REQUEST_RECEIVED, ObservationKind.RESPONSE_SENT),
    InterfaceKind.CLIENT: (ObservationKind.REQUEST_SENT, ObservationKind.RESPONSE_RECEIVED),
}
"""What a forwarded request and its response are for the machine on whose side the monitor stands."""

Ask = Callable[[Observation], bool]
"""Asks the oracle; whether what was observed is allowed."""


def monitored(system: System) -> list[Machine]:
    """The machines of the skills that the paper monitors."""
    return [machine for machine in system.nodes if machine.name in MONITORED]


class LocalOracle:
    """The models' oracles in this process."""

    def __init__(self, system: System) -> None:
        self._system = system
        self._anew()

    def begin(self) -> None:
        """Forget everything: what comes from now on is judged.

        While the monitor comes, calls fail on their way to it; that is no fault of the skills. They have
        run before, as with the passive monitor.
        """
        self._anew()
        say({"began": True})

    def _anew(self) -> None:
        system = self._system
        self._monitor = ModelMonitor(monitored(system), system.library, synchronised=False)
        self.asked = 0
        self.violations = 0
        self.reasons: list[str] = []

    def ask(self, seen: Observation) -> bool:
        """Judge ``seen``."""
        self.asked += 1
        return self._note(self._monitor.feed(seen))

    def advance(self, now_ns: int) -> None:
        """Time has passed."""
        self._note(self._monitor.advance(now_ns))

    def _note(self, verdicts: Sequence[Any]) -> bool:
        found = [verdict for verdict in verdicts if verdict.outcome is Outcome.VIOLATED]
        self.violations += len(found)
        self.reasons += [f"{item.node}: {item.reason}" for item in found[: 3 - len(self.reasons)]]
        return not found

    def standing(self) -> dict[str, Any]:
        """What it has done: asked, violations and why, the machines that conform."""
        oracles = self._monitor.oracles
        good = [name for name in oracles if oracles[name].outcome is Outcome.CONFORMING]
        return {
            "asked": self.asked,
            "violations": self.violations,
            "reasons": self.reasons,
            "conforming": sorted(good),
        }


class ManInTheMiddle:
    """Forwards the calls of the monitored skills, each after the oracle's verdict.

    Args:
        transport: its own connection.
        machines: the monitored skills.
        library: their message types.
        ask: the oracle; called before anything is forwarded, and waited for.

    Attributes:
        forwarded, failed: calls, and those of them that ended without a response.
    """

    def __init__(
        self,
        transport: Transport,
        machines: Sequence[Machine],
        library: InterfaceLibrary,
        ask: Ask,
    ) -> None:
        self.forwarded = self.failed = 0
        self._transport = transport
        self._library = library
        self._ask = ask
        self._calls = itertools.count(1)
        for machine in machines:
            for interface in machine.interfaces:
                if interface.kind in _KINDS:
                    self._stand_in(machine.name, interface)
                elif interface.kind is InterfaceKind.SUBSCRIBER:
                    self._listen_to(interface)

    def _stand_in(self, machine: str, interface: Interface) -> None:
        kind = self._library.service(interface.type_name)
        types = (kind.name, message_class(kind.request), message_class(kind.response))
        channel = str(interface.channel)
        client = self._transport.client(Service(channel, *types))
        before, after = _KINDS[interface.kind]

        def forward(request: Request) -> None:
            self.forwarded += 1
            about = {"source": machine, "client": request.client, "call": next(self._calls)}

            def answer(result: CallResult) -> None:
                if result.outcome is CallOutcome.RESPONSE:
                    self._tell(after, channel, kind.response.name, result.response, **about)
                    request.respond(result.response)
                else:
                    self.failed += 1
                    error = f"{result.outcome}: {result.error}"
                    self._tell(after, channel, kind.response.name, None, error=error, **about)
                    request.fail(result.error or str(result.outcome))

            self._tell(before, channel, kind.request.name, request.data, **about)
            client.call(request.data, answer)

        self._transport.serve(Service(rerouted(channel), *types), forward)

    def _listen_to(self, interface: Interface) -> None:
        structure = self._library.message(interface.type_name)
        topic = Topic(str(interface.channel), interface.type_name, message_class(structure))

        def hear(message: Any) -> None:
            self._tell(ObservationKind.MESSAGE, topic.name, topic.type_name, message, source="")

        self._transport.subscribe(topic, hear)

    def _tell(
        self, kind: ObservationKind, channel: str, type_name: str, message: Any, **about: Any
    ) -> None:
        now_ns = self._transport.now_ns()
        self._ask(
            Observation(
                stamp_ns=now_ns,
                received_ns=now_ns,
                channel=channel,
                kind=kind,
                type_name=type_name,
                data=None if message is None else msgspec.to_builtins(message),
                **about,
            )
        )


def over_websocket(url: str) -> tuple[Ask, Callable[[], None]]:
    """An oracle in another process: how to ask it, and how to hang up.

    By websocket-client, which ROSMonitoring's monitors use; it asks faster than other libraries do.
    """
    from websocket import create_connection

    line = create_connection(url)
    encode = msgspec.json.Encoder().encode
    decode = msgspec.json.Decoder().decode

    def ask(seen: Observation) -> bool:
        line.send(encode(seen).decode())
        return bool(decode(line.recv())["verdict"])

    return ask, line.close


def stand(transport_name: str, options: Mapping[str, str], url: str) -> None:
    """Stand in the middle until SIGTERM; at the end an oracle in this process says what it has done.

    Args:
        transport_name: of its connection.
        options: of its connection.
        url: of the oracle's WebSocket; "": the oracle is in this process.
    """
    system = read_system()
    local = LocalOracle(system)
    ask, hang_up = over_websocket(url) if url else (local.ask, lambda: None)
    transport = connect(transport_name, NODE, dict(options))
    ManInTheMiddle(transport, monitored(system), system.library, ask)
    if not url:
        transport.every(PERIOD_S, lambda: local.advance(transport.now_ns()))
    transport.announce()
    say({"ready": True})
    spin_until_ended(transport, local.begin)
    hang_up()
    if not url:
        say(local.standing())


def judge_over_websocket() -> None:
    """The oracle as ROSMonitoring has it: a process of its own, asked over a WebSocket, until SIGTERM.

    Says its ``url``, then answers each observation (JSON) with ``{"verdict": true}`` or false, and at the end
    says what was done. What judges is the passive monitor's oracle.
    """
    oracle = LocalOracle(read_system())
    asyncio.run(_judge(oracle))
    say(oracle.standing())


async def _judge(oracle: LocalOracle) -> None:
    from websockets.asyncio.server import ServerConnection, serve

    decode = msgspec.json.Decoder(Observation).decode
    encode = msgspec.json.Encoder().encode

    async def talk(line: ServerConnection) -> None:
        async for text in line:
            await line.send(encode({"verdict": oracle.ask(decode(text))}), text=True)

    ended = asyncio.Event()
    loop = asyncio.get_running_loop()
    loop.add_signal_handler(signal.SIGTERM, ended.set)

    def read() -> None:
        for _ in sys.stdin:
            loop.call_soon_threadsafe(oracle.begin)

    threading.Thread(target=read, daemon=True).start()
    async with serve(talk, "127.0.0.1", 0, compression=None) as server:
        say({"url": f"ws://127.0.0.1:{server.sockets[0].getsockname()[1]}"})
        while not ended.is_set():
            oracle.advance(time.time_ns())
            try:
                await asyncio.wait_for(ended.wait(), PERIOD_S)
            except TimeoutError:
                continue
