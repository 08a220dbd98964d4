"""What publishers offered, as rosbag2 keeps it: QoS profiles in YAML, one for each publisher of a topic.

Jazzy writes policies by name, older ones by their number in ``rmw/types.h``.
"""

from __future__ import annotations

from collections.abc import Iterable
from collections.abc import Sequence as PySequence

import msgspec

from m2c.diagnostics import DiagnosticLog
from m2c.model.machine import InterfaceKind, Machine
from moon.yaml_tree import Mapping, Scalar, Sequence, parse_yaml

OFFERED = "offered_qos_profiles"
"""The key of an MCAP channel's metadata, and the column of an SQLite file's topics."""
MAX_LENGTH = 64 * 1024
"""Longer texts are no profiles: one has some 500 characters."""

_MAX_TOPICS = 10_000
_MAX_TEXTS = 16
"""Different ones of one topic."""

_FOREVER = "\n    sec: 9223372036\n    nsec: 854775807"
_RELIABLE = ("reliable", "1")
_TRANSIENT_LOCAL = ("transient_local", "1")
_BEST_EFFORT = ("best_effort", "2")


class Offer(msgspec.Struct, frozen=True):
    """What the publishers of a topic offered.

    Attributes:
        best_effort: all of them: messages may be dropped. Who offers more is received all the same.
        transient_local: one of them at least: who comes late gets the last message.
    """

    best_effort: bool = False
    transient_local: bool = False


def note_offer(offers: dict[str, set[str]], topic: str, text: str) -> None:
    """Keep ``text`` among what was offered on ``topic``; names and texts come from a stranger's file."""
    if not 0 < len(text) <= MAX_LENGTH:
        return
    if topic in offers or len(offers) < _MAX_TOPICS:
        kept = offers.setdefault(topic, set())
        if len(kept) < _MAX_TEXTS:
            kept.add(text)


def offer_of(texts: Iterable[str]) -> Offer:
    """What is offered in ``texts``; what cannot be read in them offers what is usual."""
    reliabilities: set[str] = set()
    durabilities: set[str] = set()
    for text in texts:
        for profile in _profiles(text):
            if isinstance(profile, Mapping):
                reliabilities.add(_policy(profile, "reliability"))
                durabilities.add(_policy(profile, "durability"))
    return Offer(
        best_effort=bool(reliabilities) and reliabilities <= set(_BEST_EFFORT),
        transient_local=not durabilities.isdisjoint(_TRANSIENT_LOCAL),
    )


def publishers_in(texts: Iterable[str]) -> int:
    """How many publishers a topic has at least: each of ``texts`` is of one file, with a profile of each."""
    return max((len(_profiles(text)) for text in texts), default=0)


def _profiles(text: str) -> PySequence[object]:
    found = parse_yaml(text.encode(), OFFERED, DiagnosticLog()) if text.strip() else None
    return found.items if isinstance(found, Sequence) else ()


def declared(machines: Iterable[Machine]) -> dict[str, Offer]:
    """What the models say of topics that are not reliable and not transient local, as they usually are."""
    offers: dict[str, Offer] = {}
    for machine in machines:
        for interface in machine.interfaces:
            if interface.kind is not InterfaceKind.PUBLISHER or interface.channel is None:
                continue
            if interface.best_effort or interface.transient_local:
                offers[interface.channel] = Offer(interface.best_effort, interface.transient_local)
    return offers


def text_of(offer: Offer) -> str:
    """``offer`` as the profile of one publisher, as Jazzy writes it: rosbag2 wants all of it."""
    reliability = _BEST_EFFORT if offer.best_effort else _RELIABLE
    durability = _TRANSIENT_LOCAL[0] if offer.transient_local else "volatile"
    return (
        f"- history: keep_last\n  depth: {1 if offer.transient_local else 10}\n"
        f"  reliability: {reliability[0]}\n  durability: {durability}\n"
        f"  deadline:{_FOREVER}\n  lifespan:{_FOREVER}\n  liveliness: automatic\n"
        f"  liveliness_lease_duration:{_FOREVER}\n  avoid_ros_namespace_conventions: false\n"
    )


def _policy(profile: Mapping, name: str) -> str:
    found = profile.entries.get(name)
    return found.text.lower() if isinstance(found, Scalar) else ""
