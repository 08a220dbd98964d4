"""Channel names as Zenoh key expressions.

``/BatteryLevelSkill/tick`` travels as ``BatteryLevelSkill/tick``: a key expression has no leading
slash. A channel name must be absolute, without empty parts, without ``* $ ? #`` (Zenoh's wildcards
and separators), and no part may start with ``@`` (hidden from wildcards in Zenoh, and where this
transport keeps its own tokens, under ``@m2c``).
"""

from __future__ import annotations

from collections.abc import Iterable
from urllib.parse import quote, unquote

from transports.interface import TransportError

_ILLEGAL = "*$?#"
_GLOB = "*?["

NODE_KEYS = "@m2c/node"
"""``@m2c/node/<zid>/<name>``: a node has announced itself."""

SERVER_KEYS = "@m2c/server"
"""``@m2c/server/<zid>/<name>/<service key>``: a node serves a service."""

LINK_KEYS = "@m2c/links"
"""``@m2c/links/<zid>/<by>/<name>,<name>…``: the nodes that the session of the node ``by`` is linked to."""

ANSWER_KEYS = "@m2c/answer"
"""``@m2c/answer/<zid>/<name>``: a node says here, when it is asked, up to where it has reported
everything."""

ROUND_KEY = "@m2c/round"
"""Something here: a node has ended a round of calls (``Transport.tick_complete``)."""


def key_of(channel: str) -> str:
    """The key expression of ``channel``; TransportError if it cannot be one."""
    wrong = ""
    if not channel.startswith("/"):
        wrong = "it must start with '/'"
    elif bad := next((c for c in channel if c in _ILLEGAL), None):
        wrong = f"'{bad}' is not allowed in it"
    elif "" in channel[1:].split("/"):
        wrong = "it has an empty part"
    elif "/@" in channel:
        wrong = "a part may not start with '@'"
    if wrong:
        raise TransportError(f"channel {channel!r} cannot be named on Zenoh: {wrong}")
    return channel[1:]


def own_key(key: str, node: str) -> str:
    """Below ``key``, the key on which only ``node`` may publish: access control knows it by the name."""
    return f"{key}/{node_chunk(node)}"


def channel_of(key: str) -> str:
    """The channel of a key expression."""
    return "/" + key


def node_chunk(name: str) -> str:
    """A node's name as one part of a key expression."""
    return quote(name, safe="")


def node_of(chunk: str) -> str:
    """The node's name behind ``node_chunk``."""
    return unquote(chunk)


def subscriptions(globs: Iterable[str]) -> list[str]:
    """Key expressions that receive everything on channels matching ``globs``, none of it twice.

    A glob is cut at its first part with a wildcard: Zenoh's ``*`` stays within one part, a glob's
    does not, so the rest is filtered by the tap. ``X/**`` also receives ``X`` and its service events.
    """
    prefixes: set[tuple[str, ...]] = set()
    for glob in globs:
        parts: list[str] = []
        for part in glob.lstrip("/").split("/"):
            if any(c in part for c in _GLOB):
                break
            parts.append(part)
        prefixes.add(tuple(part for part in parts if part))
    if not prefixes:
        prefixes.add(())
    kept = [p for p in prefixes if not any(p[:n] in prefixes for n in range(len(p)))]
    return sorted("/".join((*prefix, "**")) for prefix in kept)
