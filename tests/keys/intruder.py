"""Who tries what it may not, against Zenoh alone: ``python intruder.py JSON``, an ``Attempt`` in JSON.

It holds itself to no access control, and tries everything at once: to put, to call, to answer, to announce. When it
has heard all nodes on what it may hear, what it sent before has been received or refused. Then it stays until its
standard input ends, and says in one line of JSON what came of it.
"""

from __future__ import annotations

import json
import sys
import threading
from collections import Counter
from pathlib import Path

import msgspec
import zenoh

WAIT_S = 20.0
OFTEN = 10
"""So often each node is heard: what was sent to it before it knew of the subscription has come by then."""


class Attempt(msgspec.Struct, frozen=True, kw_only=True):
    """An intruder.

    Attributes:
        folder, name: its certificate; without a name, none.
        endpoint, mode: how it connects.
        fence: what it may hear from each of ``nodes``.
        topic, service, unserved: what it sends to, calls and answers; nobody serves the last one.
        secret: what only an observer may hear.
        ghost: a node that is not there.
    """

    folder: str
    name: str
    endpoint: str
    mode: str = "peer"
    fence: str = "done"
    nodes: tuple[str, ...] = ("Skill", "Sensor")
    topic: str = "level"
    service: str = "Skill/tick"
    unserved: str = "absent"
    secret: str = "secret"
    ghost: str = "Ghost"


def configured(attempt: Attempt) -> zenoh.Config:
    """How the intruder connects."""
    folder, name = Path(attempt.folder), attempt.name
    config = zenoh.Config()
    tls: dict[str, object] = {
        "root_ca_certificate": str(folder / "ca.pem"),
        "verify_name_on_connect": False,
    }
    if name:
        for side in ("connect", "listen"):
            tls[f"{side}_certificate"] = str(folder / f"{name}.pem")
            tls[f"{side}_private_key"] = str(folder / f"{name}.key")
        tls["enable_mtls"] = True
    for key, value in {
        "mode": attempt.mode,
        "connect/endpoints": [attempt.endpoint],
        "connect/timeout_ms": 1500,
        "connect/exit_on_failure": True,
        "listen/endpoints": ["tls/0.0.0.0:0"] if name and attempt.mode == "peer" else [],
        "scouting/multicast/enabled": False,
        "timestamping/enabled": True,
        "transport/link/tls": tls,
    }.items():
        config.insert_json5(key, json.dumps(value))
    return config


def say(**said: object) -> None:
    """One line for who started this process."""
    print(json.dumps(said), flush=True)


def main(attempt: Attempt) -> None:
    """Connect, try, and say what came of it."""
    try:
        session = zenoh.open(configured(attempt))
    except zenoh.ZError as error:
        say(opened=False, why=str(error))
        return
    zid = session.info.zid()
    asked: list[str] = []
    heard: Counter[str] = Counter()
    links: Counter[str] = Counter()
    enough = threading.Event()

    def answer(query: zenoh.Query) -> None:
        asked.append(str(query.key_expr))
        query.reply(query.key_expr, b"\x80")

    def hear(sample: zenoh.Sample) -> None:
        heard[str(sample.key_expr)] += 1
        links[sample.attachment.to_bytes()[16:].decode() if sample.attachment else ""] += 1
        if all(links[node] >= OFTEN for node in attempt.nodes):
            enough.set()

    service = attempt.service
    for key in (
        attempt.topic,
        "nobodys",
        f"{service}/_service_event",
        "@m2c/round",
        "moon/verdicts",
    ):
        session.put(key, b"\x80")
        session.delete(key)
    answers = session.get(service, payload=b"\x80", timeout=2.0)
    kept: list[object] = [
        session.declare_queryable(key, answer, complete=True, allowed_origin=zenoh.Locality.REMOTE)
        for key in (service, attempt.unserved, "**")
    ]
    kept += [
        session.liveliness().declare_token(f"@m2c/{token}")
        for token in (
            *(f"node/{zid}/{name}/1" for name in (attempt.nodes[0], attempt.ghost)),
            f"server/{zid}/{attempt.nodes[0]}/{service}",
        )
    ]
    kept += [session.declare_subscriber(key, hear) for key in (attempt.fence, attempt.secret)]
    say(opened=True, fence=enough.wait(WAIT_S))
    replies = [bool(reply.ok) for reply in answers]
    sys.stdin.read()
    say(replies=replies, asked=asked, secret=heard[attempt.secret] > 0)
    session.close()


if __name__ == "__main__":
    main(msgspec.json.decode(sys.argv[1], type=Attempt))
