"""Nodes with certificates in this process, and intruders in processes of their own."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec
import zenoh
from cryptography import x509
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric import ec

from moon.keys.certificates import Pair, issued, new_authority
from moon.keys.folder import make
from tests.keys import intruder
from tests.keys.intruder import Attempt
from tests.monitor.processes import free_endpoint
from tests.transports.zenoh_network import Inbox, peer
from transports.interface import CallOutcome, Service, Topic
from transports.zenoh import ZenohTransport, connect
from transports.zenoh.access import Rights, Role

ROOT = Path(__file__).parents[2]
WAIT_S = 30.0

NODES = (
    Rights(
        name="Skill",
        role=Role.NODE,
        subscribes=("/level", "/map"),
        serves=("/Skill/tick",),
        publishes=("/done",),
        keeps_last=frozenset({"/map"}),
    ),
    Rights(
        name="Sensor",
        role=Role.NODE,
        publishes=("/level", "/secret", "/done", "/map"),
        calls=("/Skill/tick", "/absent"),
        keeps_last=frozenset({"/map"}),
    ),
)
PROCESSES = (
    *NODES,
    Rights(name="Other", role=Role.NODE, publishes=("/other",), subscribes=("/done",)),
    Rights(name="Third", role=Role.NODE, subscribes=("/done",)),
    Rights(name="several", role=Role.PROCESS, nodes=("Other", "Third")),
    Rights(name="observer", role=Role.OBSERVER),
    Rights(name="router", role=Role.ROUTER),
)
TICK = Service("/Skill/tick", "t/srv/Add", peer.AddRequest, peer.AddResponse)
ABSENT = Service("/absent", "t/srv/Add", peer.AddRequest, peer.AddResponse)
FENCE_S = 0.02


def secured_folder(folder: Path) -> Path:
    """A folder of certificates for ``PROCESSES``."""
    make(folder, "test", PROCESSES, days=100)
    return folder


def number(name: str) -> Topic:
    """A topic of numbers."""
    return Topic(name, peer.Number.__type_name__, peer.Number)


class Secured:
    """Two nodes and an observer, each with its certificate, and what they hear.

    Args:
        folder: the certificates.
        through_router: whether all are clients of a router, instead of peers.
    """

    def __init__(self, folder: Path, through_router: bool) -> None:
        self.folder = folder
        self.endpoint = free_endpoint().replace("tcp/", "tls/")
        self.mode = "client" if through_router else "peer"
        self._threads: list[threading.Thread] = []
        self._nodes: list[ZenohTransport] = []
        self.router: zenoh.Session | None = None
        if through_router:
            config = zenoh.Config.from_file(folder / "router.json5")
            config.insert_json5("listen/endpoints", json.dumps([self.endpoint]))
            self.router = zenoh.open(config)
            for file in folder.glob("*.json5"):
                file.write_text(file.read_text().replace('"mode": "peer"', '"mode": "client"'))
        self.levels, self.up, self.observed = Inbox(), Inbox(), Inbox()
        self.requests: list[str] = []
        self._nothing = threading.Event()
        skill, sensor = self._node("Skill"), self._node("Sensor")
        observer = self._node("observer")
        observer.tap([], self.observed)
        skill.subscribe(number("/level"), lambda message: self.levels(message.data))
        skill.serve(TICK, self._tick)
        skill.watch_nodes(lambda *change: self.up(change))
        self._level = sensor.publisher(number("/level"))
        self._call = sensor.client(TICK)
        self._unserved = sensor.client(ABSENT)
        for node in (skill, sensor):
            names = ("/done", "/secret") if node is sensor else ("/done",)
            for name in names:
                publisher = node.publisher(number(name))
                node.every(FENCE_S, lambda to=publisher: to.publish(peer.Number(1)))
            node.announce()
        self.up.wait(2)
        last = Topic("/map", peer.Number.__type_name__, peer.Number, transient_local=True)
        sensor.publisher(last).publish(peer.Number(9))
        self.late = Inbox()
        skill.subscribe(last, self.late)
        assert self.late.wait() == [peer.Number(9)]
        self.works()

    def _node(self, name: str) -> ZenohTransport:
        first = not (self._nodes or self.router)
        place = {"listen" if first else "endpoint": self.endpoint}
        node = connect(name, {"secure": str(self.folder), **place})
        thread = threading.Thread(target=node.spin)
        thread.start()
        self._nodes.append(node)
        self._threads.append(thread)
        return node

    def _tick(self, request: Any) -> None:
        self.requests.append(request.client)
        request.respond(peer.AddResponse(request.data.a + 1))

    def works(self) -> None:
        """A message arrives, a call is answered by who serves it, and by nobody where nobody does."""
        count = len(self.levels)
        deadline = time.monotonic() + WAIT_S
        while len(self.levels) == count:
            assert time.monotonic() < deadline, "nothing arrives"
            self._level.publish(peer.Number(7))
            self._nothing.wait(0.02)
        for value in range(5):
            result = self._call.call_and_wait(peer.AddRequest(value), 5.0)
            assert result.response == peer.AddResponse(value + 1), result
        nobody = self._unserved.call_and_wait(peer.AddRequest(), 5.0)
        assert nobody.outcome is CallOutcome.UNAVAILABLE, nobody

    def close(self) -> None:
        """End all."""
        for node in reversed(self._nodes):
            node.close()
        for thread in self._threads:
            thread.join(WAIT_S)
            assert not thread.is_alive()
        if self.router is not None:
            self.router.close()


class Intruder:
    """``intruder.py`` as a process; ``inside`` is what it is run by (``tests.transports.hosts``)."""

    def __init__(self, attempt: Attempt, inside: Sequence[str] = ()) -> None:
        self.process = subprocess.Popen(
            [*inside, sys.executable, intruder.__file__, msgspec.json.encode(attempt).decode()],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
        )
        self._watchdog = threading.Timer(WAIT_S, self.process.kill)
        self._watchdog.start()

    def said(self) -> dict[str, Any]:
        """What it says next."""
        assert self.process.stdout is not None
        said: dict[str, Any] = json.loads(self.process.stdout.readline())
        return said

    def end(self) -> dict[str, Any]:
        """Let it end; what it says of all that it tried."""
        assert self.process.stdin is not None
        self.process.stdin.close()
        return self.said()

    def close(self) -> None:
        """End it, if it still runs."""
        self._watchdog.cancel()
        self.process.kill()
        with self.process:
            pass


def with_foreign_certificate(secured: Path, folder: Path, name: str, *, expired: bool) -> Path:
    """A folder with a certificate of ``name`` that is not good for who trusts the authority of ``secured``.

    ``expired``: of that authority, and valid no longer; else of another authority.
    """
    authority = (secured / "ca.pem").read_bytes()
    signer = new_authority("another")
    if expired:
        key = serialization.load_pem_private_key((secured / "ca.key").read_bytes(), None)
        assert isinstance(key, ec.EllipticCurvePrivateKey)
        signer = Pair(x509.load_pem_x509_certificate(authority), key)
    pair = issued(signer, name, days=0 if expired else 10)
    folder.mkdir()
    (folder / "ca.pem").write_bytes(authority)
    (folder / f"{name}.pem").write_bytes(pair.certificate_pem())
    (folder / f"{name}.key").write_bytes(pair.key_pem())
    return folder
