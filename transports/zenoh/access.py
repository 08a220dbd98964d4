"""Who may declare and send what: Zenoh's access control, from the channels that each process has.

Each process has the same rules, and holds whoever it is linked to to them by the common name of its
certificate; so peers enforce them without a router, and a router enforces them where one is. What no rule
allows is refused when it comes (``ingress``). Messages and queries are refused when they leave, too
(``egress``): Zenoh sends them to a new peer before it knows what that peer has declared. Zenoh's ``**`` does
not match a part of a key that begins with ``@``: those are listed.

Zenoh's access control: https://zenoh.io/docs/manual/access-control/
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from enum import StrEnum
from typing import Any

import msgspec

from transports.service_events import EVENT_SUFFIX, TAKEN_SUFFIX
from transports.zenoh.names import (
    ANSWER_KEYS,
    LINK_KEYS,
    NODE_KEYS,
    ROUND_KEY,
    SERVER_KEYS,
    key_of,
    node_chunk,
    own_key,
)

_PUBLISHERS = "@adv/pub"
"""Below a topic's key: the publishers of the last message for who comes late (``zenoh_ext``'s advanced
publishers), each ``<topic>/@adv/pub/<zid>/<id>/<meta>``."""
_CACHES = "@adv/**"
"""Below a topic's key: what such a subscriber asks."""


_OUT = "out"
"""The rule of what may go out to everybody."""
_DECLARATIONS = [
    *("declare_subscriber", "declare_queryable", "liveliness_token"),
    *("declare_liveliness_subscriber", "liveliness_query"),
]


class Role(StrEnum):
    """What a process is in a system."""

    NODE = "node"
    POLICY = "policy"
    OBSERVER = "observer"
    LAUNCHER = "launcher"
    PROCESS = "process"
    ROUTER = "router"


class Rights(msgspec.Struct, frozen=True, kw_only=True):
    """What one process may do.

    Attributes:
        name: the common name of its certificate: the node's, or the process's.
        role: what it is. An observer may subscribe to everything; a launcher, only see who is up; a router
            may pass on whatever somebody may send; a process of several nodes, what each of them may.
        publishes, subscribes: topics.
        serves, calls: services.
        nodes: of a process, the nodes that share it.
        keeps_last: those topics of ``publishes`` and ``subscribes`` whose last message is for who comes late.
    """

    name: str
    role: Role
    publishes: tuple[str, ...] = ()
    subscribes: tuple[str, ...] = ()
    serves: tuple[str, ...] = ()
    calls: tuple[str, ...] = ()
    nodes: tuple[str, ...] = ()
    keeps_last: frozenset[str] = frozenset()


def access_control(processes: Sequence[Rights], namespace: str = "") -> dict[str, Any]:
    """Zenoh's ``access_control`` by which each of ``processes`` may do what its rights say.

    Args:
        processes: all of the system.
        namespace: the prefix of all keys, without slashes at its ends.

    Returns:
        The section as it stands in a configuration file.

    Raises:
        TransportError: a channel cannot be named on Zenoh.
    """
    begin = f"{namespace}/" if namespace else ""
    rules: list[dict[str, Any]] = []
    policies: list[dict[str, Any]] = []
    for process in processes:
        own: list[str] = []
        for flow, messages, keys in _allowed(process):
            if keys:
                own.append(f"{', '.join(messages)} {_WAYS[flow]} {process.name}")
                rules.append(_rule(own[-1], flow, messages, [begin + key for key in keys]))
        if own:
            shared = [other.name for other in processes if process.name in other.nodes]
            policies.append({"rules": own, "subjects": [process.name, *shared]})
    everything = [rule["id"] for rule in rules]
    policies += [
        {"rules": everything, "subjects": [process.name]}
        for process in processes
        if process.role is Role.ROUTER and everything
    ]
    # a reply goes only to who has asked, and was allowed to
    all_keys = ["**", f"{begin}@m2c/**", f"**/{_CACHES}"]
    rules.append(_rule(_OUT, "egress", [*_DECLARATIONS, "reply"], all_keys))
    policies.append({"rules": [_OUT], "subjects": [process.name for process in processes]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": [
            {"id": process.name, "cert_common_names": [process.name]} for process in processes
        ],
        "policies": policies,
    }


_WAYS = {"ingress": "from", "egress": "to"}


def _rule(name: str, flow: str, messages: list[str], keys: list[str]) -> dict[str, Any]:
    return {
        "id": name,
        "permission": "allow",
        "flows": [flow],
        "messages": messages,
        "key_exprs": keys,
    }


def _allowed(process: Rights) -> list[tuple[str, list[str], list[str]]]:
    """Whether it comes from ``process`` or goes to it, which messages, and on which keys (perhaps none)."""
    if process.role in (Role.ROUTER, Role.PROCESS):
        return []
    looks = [f"{NODE_KEYS}/**", *(f"{SERVER_KEYS}/*/*/{key_of(name)}" for name in process.serves)]
    if process.role is Role.OBSERVER:
        looks.append(f"{LINK_KEYS}/**")
    published = _keys(process.publishes)
    taken = _keys(process.subscribes)
    served, called = _keys(process.serves), _keys(process.calls)
    kept = _keys(sorted(process.keeps_last & {*process.publishes}))
    caught_up = _keys(sorted(process.keeps_last & {*process.subscribes}))
    caches = [f"{key}/{_PUBLISHERS}/*/*/*" for key in kept]
    puts = [*published, *(own_key(key + TAKEN_SUFFIX, process.name) for key in taken)]
    puts += [key + EVENT_SUFFIX for key in served]
    puts += [own_key(key + EVENT_SUFFIX, process.name) for key in called]
    subscriptions = list(taken)
    answers, tokens = [*served, *caches], list(caches)
    asks = [*called, *(f"{key}/{_CACHES}" for key in caught_up)]
    looks += [f"{key}/{_PUBLISHERS}/**" for key in caught_up]
    if process.role in (Role.NODE, Role.POLICY):
        chunk = node_chunk(process.name)
        subscriptions.append(ROUND_KEY)
        answers.append(f"{ANSWER_KEYS}/*/{chunk}")
        tokens += [f"{NODE_KEYS}/*/{chunk}/*", f"{LINK_KEYS}/*/{chunk}/*"]
        tokens += [f"{SERVER_KEYS}/*/{chunk}/{key}" for key in served]
    if process.role is Role.POLICY:
        puts.append(ROUND_KEY)
    if process.role is Role.OBSERVER:
        subscriptions.append("**")
        asks.append(f"{ANSWER_KEYS}/*/*")
    return [
        ("ingress", ["put"], puts),
        ("ingress", ["declare_subscriber"], subscriptions),
        ("ingress", ["declare_queryable"], answers),
        ("ingress", ["reply"], [*answers, *kept]),
        ("ingress", ["query"], asks),
        ("ingress", ["liveliness_token"], tokens),
        ("ingress", ["declare_liveliness_subscriber", "liveliness_query"], looks),
        ("egress", ["put"], subscriptions),
        ("egress", ["query"], [*answers, *(f"{key}/{_CACHES}" for key in kept)]),
    ]


def _keys(channels: Iterable[str]) -> list[str]:
    return [key_of(channel) for channel in channels]
