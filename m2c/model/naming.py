"""Names as a middleware takes them: what no transport carries, and what a single one does not.

A transport says itself what else it refuses (``transports.registry.name_rules``): here a rule is a
function, so that reading and checking models needs no middleware.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping

import msgspec

from m2c.diagnostics import DiagnosticLog, Position
from m2c.language.datatypes import Array, DataType, Structure, describe

NameRule = Callable[[str, str], tuple[str, str] | None]
"""Of what (``node``, ``topic``, ``service``, ``action``; of messages ``field``, ``type``, ``structure``) and
the name: why it is refused, and one that works ("" if only the writer can find one); None if it is taken."""

_WILD = "*$?#"
"""Zenoh's wildcards and separators; ROS 2 has none of them either."""
_EXAMPLE = "node/value"
_NAMED = {"node": "name of a node"}


class Naming(msgspec.Struct, frozen=True):
    """Where names must work.

    Attributes:
        rules: what each transport refuses, by the transport's name.
        chosen: the nodes run on these: a refusal is an error; else they might, and it is a warning.
        needs_packages: whether nodes there import interface packages, which have to be installed.
    """

    rules: Mapping[str, NameRule] = {}
    chosen: bool = False
    needs_packages: bool = False


ANYWHERE = Naming()
"""No transport is asked: only what none of them takes is refused."""


def absolute(channel: str) -> str:
    """The name of a channel as others know it: where it is written, its first ``/`` may be left out."""
    return channel if channel.startswith("/") else f"/{channel}"


def check_node(
    name: str, position: Position, element: str, naming: Naming, log: DiagnosticLog
) -> None:
    """Report a transport that does not take ``name`` for a node (``bad-name``, ``unportable-name``)."""
    _ask("node", name, position, element, naming, log)


def check_field(
    name: str, kind: DataType, position: Position, naming: Naming, log: DiagnosticLog
) -> None:
    """Report a transport that does not take a param of a plain event as a field, or its type.

    Of a structure that the system declares, its name and its members are looked at, too.
    """
    _ask("field", name, position, "param", naming, log)
    _ask("type", describe(kind), position, "param", naming, log)
    while isinstance(kind, Array):
        kind = kind.element
    if isinstance(kind, Structure) and "/" not in kind.name:  # else an interface package has it
        _ask("structure", kind.name, position, "param", naming, log)
        for member, inner in kind.fields:
            check_field(member, inner, position, naming, log)


def check_channel(
    kind: str, name: str, position: Position, element: str, naming: Naming, log: DiagnosticLog
) -> None:
    """Report ``bad-name`` or ``unportable-name`` for a channel that cannot be called ``name``.

    Args:
        kind: ``topic``, ``service`` or ``action``.
        name: absolute.
        position: where it is written.
        element: in which element; "" if that says nothing.
        naming: the transports that must take it.
        log: where the finding goes, with a name that works.
    """
    parts = name.removeprefix("/").split("/")
    wild = next((letter for letter in name if letter in _WILD), "")
    hidden = next((part for part in parts if part.startswith("@")), "")
    if any(not part.strip() for part in parts):
        what = "has an empty part"
    elif wild:
        what = f"has `{wild}`, which no transport takes in a name"
    elif hidden:
        what = f"has a part that begins with @, `{hidden}`, which no transport takes"
    else:
        _ask(kind, name, position, element, naming, log)
        return
    message = f"the channel `{name}` {what}"
    log.error("bad-name", position, element, message, f"write it like /{_without_wild(parts)}")


def _without_wild(parts: list[str]) -> str:
    plain = (re.sub(r"[*$?#]+", "_", part.strip()).lstrip("@").strip("_") for part in parts)
    return "/".join(part for part in plain if part) or _EXAMPLE


def _ask(
    kind: str, name: str, position: Position, element: str, naming: Naming, log: DiagnosticLog
) -> None:
    for transport, rule in naming.rules.items():
        refusal = rule(kind, name)
        if refusal is None:
            continue
        why, instead = refusal
        called = _NAMED.get(kind, kind)
        what = f"the {transport} transport does not take the {called} `{name}`: {why}"
        hint = f"write {instead}" if instead else "write a shorter one"
        if naming.chosen:
            log.error("bad-name", position, element, what, hint)
        else:
            log.warning("unportable-name", position, element, what, hint)
