"""What a stranger on the network does: each attack a function, run in a process of its own.

``python -m tests.attacks.strangers ATTACK ENDPOINT --seed S --seconds T`` runs one against whatever is there. The
attackers are written against Zenoh alone, as a stranger's tools are; from the project they only know the names and
types of the tour, which anybody can read.
"""

from __future__ import annotations

import argparse
import json
import random
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import msgspec
import zenoh

from m2c.language.datatypes import INTEGER_RANGES, Array, DataType, Primitive, Structure
from m2c.model.machine import InterfaceKind
from moon.monitor.reading import read_checked

SYSTEM = Path(__file__).parents[2] / "examples" / "lab_tour" / "system.xml"
EVENTS = "/_service_event"


class Channel(msgspec.Struct, frozen=True):
    """A channel of the tour: its key, type, the structure of its messages, and the nodes at its ends."""

    key: str
    type_name: str
    structure: Structure
    nodes: tuple[str, ...]


class Stranger:
    """A session that nobody asked for.

    Args:
        endpoint: where the tour meets.
        seed: of all that is random.
        seconds: how long an attack goes on.
    """

    def __init__(self, endpoint: str, seed: int, seconds: float) -> None:
        self.random = random.Random(seed)
        self._endpoint = endpoint
        self._until_s = time.monotonic() + seconds
        self._opened: list[zenoh.Session] = []
        self.session = self.another()
        system = read_checked([SYSTEM])
        topics: dict[str, Channel] = {}
        services: dict[str, Channel] = {}
        for machine in (*system.nodes, *system.plugins):
            for interface in machine.interfaces:
                if interface.channel is None:
                    continue
                key, name = interface.channel[1:], interface.type_name
                if interface.kind in (InterfaceKind.PUBLISHER, InterfaceKind.SUBSCRIBER):
                    place, structure = topics, system.library.message(name)
                elif interface.kind in (InterfaceKind.SERVER, InterfaceKind.CLIENT):
                    place, structure = services, system.library.service(name).request
                else:
                    continue
                ends = place[key].nodes if key in place else ()
                place[key] = Channel(key, name, structure, (*ends, machine.name))
        self.topics = [topics[key] for key in sorted(topics)]
        self.services = [services[key] for key in sorted(services)]
        self.nodes = sorted({machine.name for machine in system.nodes})

    def another(self) -> zenoh.Session:
        """One more session."""
        config = zenoh.Config()
        for key, value in (
            ("mode", "peer"),
            ("connect/endpoints", [self._endpoint]),
            ("listen/endpoints", ["tcp/127.0.0.1:0"]),
            ("scouting/multicast/enabled", False),
            ("timestamping/enabled", self.random.random() < 0.7),
            ("connect/exit_on_failure", True),
            ("connect/timeout_ms", 5000),
        ):
            config.insert_json5(key, json.dumps(value))
        self._opened.append(zenoh.open(config))
        return self._opened[-1]

    def goes_on(self) -> bool:
        return time.monotonic() < self._until_s

    def pace(self, per_second: float) -> None:
        time.sleep(1 / per_second)

    def close(self) -> None:
        for session in self._opened:
            session.close()

    # --- what is sent ------------------------------------------------------------------------------

    def text(self, most: int = 30) -> str:
        letters = "ab/%\x1b[31m\n\u202eäé日*?#$@-_0123456789"
        return "".join(self.random.choices(letters, k=self.random.randint(0, most)))

    def plain(self, depth: int = 3) -> Any:
        """Anything that MessagePack can hold."""
        choice = self.random.randint(0, 10 if depth else 7)
        if choice >= 8:
            items = [self.plain(depth - 1) for _ in range(self.random.randint(0, 4))]
            keys = [
                self.random.choice(["data", "status", "info", 1, b"x", self.text(5)]) for _ in items
            ]
            return items if choice == 8 else dict(zip(keys, items, strict=True))
        return self.random.choice(
            [
                *(None, True, 0, -1, 2**31, 2**63 - 1, 2**64 - 1, -(2**63)),
                *(1e308, float("nan"), float("inf"), self.text(), b"\xff" * 9, ""),
                msgspec.msgpack.Ext(5, b"x"),
            ]
        )

    def payload(self) -> bytes:
        """Bytes that are mostly no message."""
        kind = self.random.randint(0, 5)
        if kind == 0:
            return self.random.randbytes(self.random.randint(0, 200))
        if kind == 1:
            deepest = self.random.choice([200, 1000, 60_000])  # Python's stack ends at about 1000
            return (
                self.random.choice([b"\x91", b"\x81\xa1a"]) * self.random.randint(1, deepest)
                + b"\x01"
            )
        if kind == 2:
            return self.random.choice(
                [b"\xdd\xff\xff\xff\xff", b"\xdf\x7f\xff\xff\xff", b"\x81\x80\x01"]
            )
        whole = msgspec.msgpack.encode(self.plain())
        return whole if kind > 3 else whole[: self.random.randint(0, len(whole))]

    def attachment(self, node: str = "") -> bytes:
        """What claims to be from ``node``, or is malformed."""
        if node:
            numbers = [self.random.choice([0, 1, 7, self.random.getrandbits(20)]) for _ in range(2)]
            return b"".join(number.to_bytes(8, "little") for number in numbers) + node.encode()
        return self.random.randbytes(self.random.choice([0, 1, 8, 15, 16, 17, 40, 2000]))

    def message(self, structure: Structure) -> dict[str, Any]:
        """A message of the right type, with any values."""
        return {name: self._value(kind) for name, kind in structure.fields}

    def _value(self, kind: DataType) -> Any:
        match kind:
            case Primitive("bool"):
                return self.random.random() < 0.5
            case Primitive("string"):
                return self.text()
            case Primitive(name) if name in INTEGER_RANGES:
                least, most = INTEGER_RANGES[name]
                return self.random.choice([0, 1, 20, 90, least, min(most, 2**63 - 1)])
            case Primitive():
                return self.random.choice([0.0, 1e300, float("nan"), -1.5])
            case Structure():
                return self.message(kind)
            case Array(element, length, _):
                return [self._value(element) for _ in range(length or 2)]
        raise AssertionError(kind)


Attack = Callable[[Stranger], None]


def tokens(stranger: Stranger) -> None:
    """Declares tokens of every form, under the project's keys, and withdraws them."""
    declared: list[Any] = []
    liveliness = stranger.session.liveliness()
    fixed = [
        *("@m2c/node/evil", "@m2c/links/evil", "@m2c/server/evil", "@m2c", "@m2c/node"),
        *("@m2c/node/ab/zzz/" + "9" * 5000, "@m2c/links/ab/" + "%41," * 9000),
    ]
    while stranger.goes_on():
        chunks = [
            stranger.random.choice(
                [
                    "ab",
                    "-",
                    "%ff",
                    "x" * 250,
                    "1",
                    "9" * 30,
                    "a,b",
                    f"{stranger.random.getrandbits(64):x}",
                ]
            )
            for _ in range(stranger.random.randint(0, 4))
        ]
        prefix = stranger.random.choice(["@m2c/node", "@m2c/links", "@m2c/server"])
        key = stranger.random.choice([*fixed, "/".join([prefix, *chunks])])
        declared.append(liveliness.declare_token(key))
        if len(declared) > 500:
            declared.pop(stranger.random.randrange(500)).undeclare()
        stranger.pace(500)


def names(stranger: Stranger) -> None:
    """Announces hundreds of nodes whose names are long, again and again."""
    liveliness, zid = stranger.session.liveliness(), stranger.session.info.zid()
    while stranger.goes_on():
        begin = stranger.random.getrandbits(32)
        declared = [
            liveliness.declare_token(f"@m2c/node/{zid}/{begin + number:0200}/1")
            for number in range(300)
        ]
        time.sleep(0.3)
        for token in declared:
            token.undeclare()


def payloads(stranger: Stranger) -> None:
    """Publishes what is no message on every key, with attachments and encodings of every form."""
    keys = [
        *(topic.key for topic in stranger.topics),
        *(service.key for service in stranger.services),
        *(service.key + EVENTS for service in stranger.services),
        *(
            "NavigationComponent/GoToPoi/_action/feedback",
            "NavigationComponent/GoToPoi/_action/status",
        ),
        *("policy/ticks", "moon/verdicts", "@m2c/round", "nobody/knows", "m2c/interfaces"),
    ]
    while stranger.goes_on():
        stranger.session.put(
            stranger.random.choice(keys),
            stranger.payload(),
            encoding=stranger.random.choice(["", "application/msgpack;x/msg/Y", "zenoh/string;é"]),
            attachment=stranger.attachment(
                stranger.random.choice(["", "evil", "\x1b[31m", "x" * 300])
            ),
        )
        stranger.pace(1000)


def wrongly_typed(stranger: Stranger) -> None:
    """Publishes what says that it is of the right type, numbered as by a node, and is not."""
    while stranger.goes_on():
        topic = stranger.random.choice(stranger.topics)
        data = stranger.random.choice([stranger.plain(), {"data": stranger.plain()}])
        stranger.session.put(
            topic.key,
            msgspec.msgpack.encode(data),
            encoding=f"application/msgpack;{topic.type_name}",
            attachment=stranger.attachment("evil"),
        )
        service = stranger.random.choice(stranger.services)
        now_ns = time.time_ns()
        event = {
            "info": {
                "event_type": stranger.random.choice([0, 1, 2, 3, 9]),
                "stamp_ns": stranger.random.choice(
                    [now_ns, 0, now_ns + 10**15, 2**63 - 1, 2**64 - 1, -1]
                ),
                "client": stranger.random.choice(["evil", "policy", stranger.text()]),
                "sequence_number": stranger.random.choice([0, 1, 2**63, 2**40]),
            },
            "request": stranger.plain(),
            "response": stranger.plain(),
        }
        stranger.session.put(
            service.key + EVENTS,
            msgspec.msgpack.encode(event),
            encoding=f"application/msgpack;{service.type_name}_Event",
            attachment=stranger.attachment("evil"),
        )
        stranger.pace(300)


def foreign_values(stranger: Stranger) -> None:
    """Publishes messages of the right type, with changing values, on every topic that a machine takes."""
    while stranger.goes_on():
        for topic in stranger.topics:
            stranger.session.put(
                topic.key,
                msgspec.msgpack.encode(stranger.message(topic.structure)),
                encoding=f"application/msgpack;{topic.type_name}",
            )
        stranger.pace(300)


def forged_sources(stranger: Stranger) -> None:
    """Publishes and answers in the names of nodes, from a session that is not theirs."""
    while stranger.goes_on():
        topic = stranger.random.choice(stranger.topics)
        stranger.session.put(
            topic.key,
            msgspec.msgpack.encode(stranger.message(topic.structure)),
            encoding=f"application/msgpack;{topic.type_name}",
            attachment=stranger.attachment(stranger.random.choice(topic.nodes)),
        )
        service = stranger.random.choice(stranger.services)
        event = {
            "info": {
                "event_type": stranger.random.choice([1, 2]),
                "stamp_ns": time.time_ns(),
                "client": "policy",
                "sequence_number": stranger.random.randint(0, 1000),
            },
            "request": stranger.message(service.structure),
            "response": {"status": 1, "is_ok": False},
        }
        stranger.session.put(
            service.key + EVENTS,
            msgspec.msgpack.encode(event),
            encoding=f"application/msgpack;{service.type_name}_Event",
            attachment=stranger.attachment(stranger.random.choice(service.nodes)),
        )
        stranger.pace(100)


def twins(stranger: Stranger) -> None:
    """Announces nodes that are up once more, from another session and in the name of theirs."""
    liveliness = stranger.session.liveliness()
    zids = [str(zid) for zid in stranger.session.info.peers_zid()]
    while stranger.goes_on():
        node = stranger.random.choice(stranger.nodes)
        zid = stranger.random.choice([str(stranger.session.info.zid()), *zids])
        since = stranger.random.choice([time.time_ns(), 1, 2**62])
        token = liveliness.declare_token(f"@m2c/node/{zid}/{node}/{since}")
        forged_sources_of(stranger, node)
        stranger.pace(20)
        token.undeclare()


def forged_sources_of(stranger: Stranger, node: str) -> None:
    for topic in stranger.topics:
        if node in topic.nodes:
            stranger.session.put(
                topic.key,
                msgspec.msgpack.encode(stranger.message(topic.structure)),
                encoding=f"application/msgpack;{topic.type_name}",
                attachment=stranger.attachment(node),
            )


def huge(stranger: Stranger) -> None:
    """Publishes messages of many MB, among them what grows as it is decoded."""
    while stranger.goes_on():
        size = stranger.random.choice([10**6, 8 * 10**6, 30 * 10**6])
        body = stranger.random.choice(
            [
                msgspec.msgpack.encode(bytes(size)),
                b"\xdd" + (size // 8).to_bytes(4, "big") + b"\x80" * (size // 8),
            ]
        )
        key = stranger.random.choice(
            [stranger.topics[0].key, "large", stranger.services[0].key + EVENTS]
        )
        stranger.session.put(key, body)
        stranger.pace(4)


def large_flood(stranger: Stranger) -> None:
    """Publishes messages of 1 MB as fast as it can."""
    body = msgspec.msgpack.encode(stranger.random.randbytes(1_000_000))
    while stranger.goes_on():
        stranger.session.put("large", body, congestion_control=zenoh.CongestionControl.DROP)


def small_flood(stranger: Stranger) -> None:
    """Publishes small messages as fast as it can: on a topic of nobody's, and of a wrong type on one that is taken."""
    topic = stranger.topics[0].key
    while stranger.goes_on():
        for _ in range(100):
            stranger.session.put("small", b"\x01", congestion_control=zenoh.CongestionControl.DROP)
        stranger.session.put(topic, b"\x01", encoding="application/msgpack;x/msg/Y")


def many_names(stranger: Stranger) -> None:
    """Publishes on ever new channels, in ever new names, of ever new types."""
    number = 0
    while stranger.goes_on():
        number += 1
        stranger.session.put(
            f"new/{number}",
            b"\x81\xa4data\x01",
            encoding=f"application/msgpack;x/msg/T{number}",
            attachment=stranger.attachment(f"evil{number}"),
        )
        stranger.session.put(
            stranger.topics[0].key, b"\x01", attachment=stranger.attachment(f"e{number}")
        )
        stranger.pace(3000)


def calls(stranger: Stranger) -> None:
    """Calls every service, rightly and wrongly, without waiting for answers."""
    while stranger.goes_on():
        service = stranger.random.choice(stranger.services)
        wrong = stranger.random.random() < 0.5
        body = (
            stranger.payload()
            if wrong
            else msgspec.msgpack.encode(stranger.message(service.structure))
        )
        stranger.session.get(
            service.key,
            zenoh.handlers.Callback(lambda reply: None),
            payload=body,
            encoding=stranger.random.choice(
                ["", f"application/msgpack;{service.type_name}_Request"]
            ),
            attachment=stranger.attachment(stranger.random.choice(["", "evil"])),
            timeout=2,
        )
        stranger.pace(200)


def call_flood(stranger: Stranger) -> None:
    """Sends requests that are none, as fast as it can."""
    keys = [service.key for service in stranger.services]
    ignore = zenoh.handlers.Callback(lambda reply: None)
    while stranger.goes_on():
        stranger.session.get(
            stranger.random.choice(keys), ignore, payload=b"\xc1" * 1000, timeout=1
        )


def evil_servers(stranger: Stranger) -> None:
    """Answers requests to every service with what is no answer, many times each."""

    def answer(query: zenoh.Query) -> None:
        for _ in range(20):
            query.reply(query.key_expr, stranger.payload(), encoding="application/msgpack;x/srv/Y")
        query.drop()

    served = [
        stranger.session.declare_queryable(service.key, answer, complete=True)
        for service in stranger.services
    ]
    while stranger.goes_on():
        stranger.pace(20)
    for queryable in served:
        queryable.undeclare()


def rounds(stranger: Stranger) -> None:
    """Says that a round of calls is over, as fast as it can."""
    while stranger.goes_on():
        stranger.session.put("@m2c/round", b"x" * 100)


def visitors(stranger: Stranger) -> None:
    """Opens sessions that hear all, and close again."""
    while stranger.goes_on():
        session = stranger.another()
        session.declare_subscriber("**", zenoh.handlers.RingChannel(10))
        session.liveliness().declare_token(f"@m2c/node/{session.info.zid()}/visitor/1")
        stranger.pace(20)
        session.close()


def deaf_reader(stranger: Stranger) -> None:
    """Hears all, and reads nothing: whoever starts it stops it (SIGSTOP)."""
    stranger.session.declare_subscriber("**", zenoh.handlers.FifoChannel(1))
    while stranger.goes_on():
        time.sleep(0.1)


ATTACKS: dict[str, Attack] = {
    attack.__name__: attack
    for attack in (
        *(tokens, names, payloads, wrongly_typed, foreign_values, forged_sources, twins, huge),
        *(
            large_flood,
            small_flood,
            many_names,
            calls,
            call_flood,
            rounds,
            visitors,
            deaf_reader,
            evil_servers,
        ),
    )
}


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description="Attack a tour that runs at ENDPOINT.")
    parser.add_argument("attack", choices=[*ATTACKS])
    parser.add_argument("endpoint")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=5.0)
    chosen = parser.parse_args(arguments)
    stranger = Stranger(chosen.endpoint, chosen.seed, chosen.seconds)
    print("attacking", flush=True)
    ATTACKS[chosen.attack](stranger)
    stranger.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
