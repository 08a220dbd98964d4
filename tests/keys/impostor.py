"""Who has a node's certificate and speaks in the names of others: ``python impostor.py JSON``, an ``Imposture`` in JSON.

It holds itself to no access control. Until its standard input ends it says in other names whatever the wire has
a name in: messages, reports of calls and of messages taken, announcements, links, answers, calls; on its own keys
and on all others; stamped by its own session or in that of the node that it names.
"""

from __future__ import annotations

import contextlib
import json
import random
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import zenoh

from m2c.language.datatypes import Array, DataType, Primitive, Structure
from m2c.model.machine import InterfaceKind
from moon.monitor.reading import read_checked
from tests.keys.intruder import Attempt, configured, say

PACE_S = 0.004


class Imposture(msgspec.Struct, frozen=True, kw_only=True):
    """An impostor.

    Attributes:
        folder, name: its certificate; without a folder, it needs none.
        endpoint: where it connects.
        system: the models.
        seed: of what it says.
        only: what it does, by the names of its methods; empty: everything.
    """

    folder: str
    name: str
    endpoint: str
    system: str
    seed: int = 1
    only: tuple[str, ...] = ()


class Impostor:
    """Says in the names of others whatever can be said."""

    def __init__(self, imposture: Imposture) -> None:
        self._random = random.Random(imposture.seed)
        self._name = imposture.name
        self._session = zenoh.open(_configuration(imposture))
        self._zid = str(self._session.info.zid())
        self._library = system = read_checked([Path(imposture.system)])
        self.nodes = sorted({machine.name for machine in system.nodes} - {imposture.name})
        self._topics: dict[str, str] = {}
        self._services: dict[str, str] = {}
        self._own: list[str] = []
        self._published: set[tuple[str, str]] = set()
        for machine in system.nodes:
            for interface in machine.interfaces:
                key = (interface.channel or "")[1:]
                if interface.kind in (InterfaceKind.PUBLISHER, InterfaceKind.SUBSCRIBER):
                    self._topics[key] = interface.type_name
                    if interface.kind is InterfaceKind.PUBLISHER:
                        self._published.add((machine.name, key))
                        if machine.name == self._name:
                            self._own.append(key)
                elif interface.kind in (InterfaceKind.SERVER, InterfaceKind.CLIENT):
                    self._services[key] = interface.type_name
        self._up: dict[str, str] = {}
        self._kept: list[Any] = [
            self._session.liveliness().declare_subscriber("@m2c/node/**", self._note, history=True)
        ]
        self._numbers = 0

    def _note(self, sample: zenoh.Sample) -> None:
        zid, name, *_ = str(sample.key_expr).removeprefix("@m2c/node/").split("/")
        if zid != self._zid:
            self._up[name] = zid

    @property
    def is_ready(self) -> bool:
        """Whether it knows the sessions of all whose names it takes."""
        return {*self.nodes} <= self._up.keys()

    def close(self) -> None:
        self._session.close()

    # --- what it says ------------------------------------------------------------------------------

    def publish(self) -> None:
        """A message of the right type in another's name, mostly on its own topic."""
        own = self._own if self._own and self._random.random() < 0.7 else sorted(self._topics)
        key = self._random.choice(own)
        type_name = self._topics[key]
        self._put(key, type_name, self._value(self._library.library.message(type_name)))

    def misname(self) -> None:
        """A message of the right type, in the name of a node that does not publish on its topic."""
        key = self._random.choice(sorted(self._topics))
        node = self._random.choice([n for n in self.nodes if (n, key) not in self._published])
        message = self._value(self._library.library.message(self._topics[key]))
        self._put(key, self._topics[key], message, node)

    def report_call(self) -> None:
        """Something of a call, as another would report it of itself."""
        key = self._random.choice(sorted(self._services))
        service = self._library.library.service(self._services[key])
        node = self._random.choice(self.nodes)
        event = {
            "info": {
                "event_type": self._random.randrange(4),
                "stamp_ns": time.time_ns(),
                "client": self._random.choice([node, "policy", self._name]),
                "sequence_number": self._random.randrange(1000),
            },
            "request": self._value(service.request),
            "response": self._value(service.response),
        }
        own = self._random.choice(["", f"/{node}", f"/{self._name}", "/policy"])
        self._put(f"{key}/_service_event{own}", f"{self._services[key]}_Event", event, node)

    def report_taken(self) -> None:
        """That another has taken a message."""
        key = self._random.choice(sorted(self._topics))
        node = self._random.choice(self.nodes)
        event = {
            "info": {
                "event_type": 4,
                "stamp_ns": time.time_ns(),
                "client": self._random.choice([*self.nodes, self._name]),
                "sequence_number": self._random.randrange(1000),
            }
        }
        own = self._random.choice(["", f"/{node}", f"/{self._name}"])
        self._put(f"{key}/_message_taken{own}", self._topics[key], event, node)

    def announce(self) -> None:
        """Another node, one that is not there, and whom it would be linked to."""
        node = self._random.choice([*self.nodes, "GhostA"])
        zid = self._random.choice([self._zid, *self._up.values()])
        key = self._random.choice(
            [
                f"@m2c/node/{zid}/{node}/{time.time_ns()}",
                f"@m2c/links/{zid}/GhostA",
                f"@m2c/links/{zid}/{self._name}/GhostA,GhostB",
                f"@m2c/links/{zid}/{node}/GhostC",
            ]
        )
        self._kept.append(self._session.liveliness().declare_token(key))
        if len(self._kept) > 50:
            self._kept.pop(1).undeclare()

    def answer(self) -> None:
        """How far another is said to have reported."""
        node = self._random.choice(self.nodes)
        key = f"@m2c/answer/{self._up[node]}/{node}"

        def reply(query: zenoh.Query) -> None:
            with contextlib.suppress(zenoh.ZError):
                query.reply(
                    key, b"", attachment=self._attachment(node), timestamp=self._stamp(node)
                )
            query.drop()

        self._kept.append(self._session.declare_queryable(key, reply))

    def call(self) -> None:
        """A service, in another's name."""
        key = self._random.choice(sorted(self._services))
        service = self._library.library.service(self._services[key])
        self._session.get(
            key,
            zenoh.handlers.Callback(lambda reply: None),
            payload=msgspec.msgpack.encode(self._value(service.request)),
            encoding=f"application/msgpack;{self._services[key]}_Request",
            attachment=self._attachment(self._random.choice(self.nodes)),
            timeout=2,
        )

    def _put(self, key: str, type_name: str, data: object, node: str = "") -> None:
        node = node or self._random.choice(self.nodes)
        self._session.put(
            key,
            msgspec.msgpack.encode(data),
            encoding=f"application/msgpack;{type_name}",
            attachment=self._attachment(node),
            timestamp=self._stamp(node) if self._random.random() < 0.7 else None,
        )

    def _attachment(self, node: str) -> bytes:
        self._numbers += 1
        number = self._random.choice([self._numbers, 0, self._random.randrange(100)])
        order = self._random.choice([self._numbers, 0, self._random.randrange(10**6)])
        return number.to_bytes(8, "little") + order.to_bytes(8, "little") + node.encode()

    def _stamp(self, node: str) -> zenoh.Timestamp:
        """Now, as by the session of ``node``."""
        now_ns = time.time_ns()
        moment = time.strftime("%Y-%m-%dT%H:%M:%S", time.gmtime(now_ns // 10**9))
        text = f"{moment}.{now_ns % 10**9:09d}Z/{self._up.get(node, self._zid)}"
        return zenoh.Timestamp.parse_rfc3339(text)

    def _value(self, kind: DataType | Structure) -> Any:
        match kind:
            case Structure():
                return {name: self._value(field) for name, field in kind.fields}
            case Array(element, length, _):
                return [self._value(element) for _ in range(length or 1)]
            case Primitive("string"):
                return "x"
            case Primitive("bool"):
                return self._random.random() < 0.5
            case _:
                return self._random.randrange(3)


def _configuration(imposture: Imposture) -> zenoh.Config:
    if imposture.folder:
        attempt = Attempt(folder=imposture.folder, name=imposture.name, endpoint=imposture.endpoint)
        return configured(attempt)
    config = zenoh.Config()
    for key, value in {
        "mode": "peer",
        "connect/endpoints": [imposture.endpoint],
        "listen/endpoints": ["tcp/127.0.0.1:0"],
        "scouting/multicast/enabled": False,
        "timestamping/enabled": True,
    }.items():
        config.insert_json5(key, json.dumps(value))
    return config


def main(imposture: Imposture) -> None:
    """Speak in other names until standard input ends."""
    impostor = Impostor(imposture)
    over = threading.Event()

    def wait() -> None:
        sys.stdin.read()
        over.set()

    threading.Thread(target=wait, daemon=True).start()
    while not impostor.is_ready and not over.wait(0.02):
        pass
    says: list[Callable[[], None]] = [
        *(impostor.publish, impostor.publish, impostor.misname, impostor.report_call),
        *(impostor.report_taken, impostor.announce, impostor.answer, impostor.call),
    ]
    says = [each for each in says if not imposture.only or each.__name__ in imposture.only]
    say(ready=impostor.is_ready)
    turns = random.Random(imposture.seed)
    count = 0
    while not over.wait(PACE_S):
        turns.choice(says)()
        count += 1
        if count == 500:
            say(said=count)
    impostor.close()


if __name__ == "__main__":
    main(msgspec.json.decode(sys.argv[1], type=Imposture))
