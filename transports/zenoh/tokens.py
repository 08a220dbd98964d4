"""Liveliness tokens as they are written in keys, and read from anybody's.

Any peer may declare any token. What is read here is either whole or refused (``TokenError``); nothing else is
raised, whatever the key. What a token says is not proved: a peer may declare one in another's name.
"""

from __future__ import annotations

import re
from collections.abc import Iterable

import msgspec

from transports.zenoh.names import (
    ANSWER_KEYS,
    LINK_KEYS,
    NODE_KEYS,
    SERVER_KEYS,
    channel_of,
    node_chunk,
    node_of,
)

MOST_NAME = 255
"""Characters of a node's name: what ROS 2 allows (``RMW_NODE_NAME_MAX_NAME_LENGTH``)."""
MOST_LINKS = 16 * 1024
"""Characters of the list of names in a token of ``LINK_KEYS``. Zenoh sends a key in one batch of 64 KB, and
panics at one that does not fit; and to whom a node is linked, others decide."""
_ZID = re.compile(r"[0-9A-Za-z]{1,32}")
"""A session's id: up to 16 bytes in hexadecimal digits."""
_BEGAN = re.compile(r"([0-9]{1,19})(?:-([0-9a-f]{32}))?")
"""When a node began, and on which host."""
MOST_NS = 2**63 - 1
"""The latest moment, ns since the epoch (the year 2262): more does not fit in what is recorded."""
NOBODY = "-"
"""Stands for an empty list of names."""


class TokenError(Exception):
    """A key that is no token of ours; the text says what is wrong with it."""


class NodeToken(msgspec.Struct, frozen=True):
    """A node that has announced itself: ``@m2c/node/<zid>/<name>/<since_ns>-<host>``.

    Attributes:
        zid: the session that says so.
        name: the node's.
        since_ns: when it began to connect, as it says itself (ns since the epoch); 0 if it does not say.
        host: of which host it is (``transports.host.ID``); "" if it does not say.
    """

    zid: str
    name: str
    since_ns: int = 0
    host: str = ""


class LinkToken(msgspec.Struct, frozen=True):
    """The nodes that a session is linked to: ``@m2c/links/<zid>/<by>/<name>,<name>…``.

    Attributes:
        zid: the session, as who declares it says.
        names: those that it is linked to.
        by: the node that says so, one of those on the session: access control binds this name to a
            certificate; "" if it does not say.
    """

    zid: str
    names: tuple[str, ...]
    by: str = ""


class ServerToken(msgspec.Struct, frozen=True):
    """A node that serves a service: ``@m2c/server/<zid>/<name>/<service key>``."""

    zid: str
    name: str
    service: str


def read_node(key: str) -> NodeToken:
    """The token under ``NODE_KEYS``; TokenError if ``key`` is none."""
    zid, parts = _parts(NODE_KEYS, key)
    if len(parts) not in (1, 2):
        raise TokenError(f"{len(parts)} parts where a name and a time are expected")
    began = _BEGAN.fullmatch(parts[1] if len(parts) == 2 else "0")
    if began is None or int(began[1]) > MOST_NS:
        raise TokenError("its time is no number of ns since the epoch")
    return NodeToken(zid, _name(parts[0]), int(began[1]), began[2] or "")


def read_links(key: str) -> LinkToken:
    """The token under ``LINK_KEYS``; TokenError if ``key`` is none."""
    zid, parts = _parts(LINK_KEYS, key)
    if len(parts) not in (1, 2):
        raise TokenError(f"{len(parts)} parts where a name and a list of names are expected")
    *by, names = parts
    if len(names) > MOST_LINKS:
        raise TokenError(f"a list of names of more than {MOST_LINKS} characters")
    chunks = () if names == NOBODY else names.split(",")
    return LinkToken(zid, tuple(_name(chunk) for chunk in chunks), _name(by[0]) if by else "")


def read_server(key: str) -> ServerToken:
    """The token under ``SERVER_KEYS``; TokenError if ``key`` is none."""
    zid, parts = _parts(SERVER_KEYS, key)
    if len(parts) < 2:
        raise TokenError("it names no service")
    return ServerToken(zid, _name(parts[0]), channel_of("/".join(parts[1:])))


def node_key(zid: str, name: str, since_ns: int, host: str = "") -> str:
    """What ``read_node`` reads."""
    began = f"{since_ns}-{host}" if host else f"{since_ns}"
    return f"{NODE_KEYS}/{zid}/{node_chunk(name)}/{began}"


def answer_key(zid: str, name: str) -> str:
    """Where a node is asked up to where it has reported everything."""
    return f"{ANSWER_KEYS}/{zid}/{node_chunk(name)}"


def links_key(zid: str, names: Iterable[str], by: str = "") -> str:
    """What ``read_links`` reads: as many of ``names`` as there is room for, in their order."""
    chunks: list[str] = []
    room = MOST_LINKS
    for name in names:
        chunk = node_chunk(name)
        room -= len(chunk) + 1
        if room < 0:
            break
        chunks.append(chunk)
    speaker = f"/{node_chunk(by)}" if by else ""
    return f"{LINK_KEYS}/{zid}{speaker}/{','.join(chunks) or NOBODY}"


def server_key(zid: str, name: str, key: str) -> str:
    """What ``read_server`` reads; ``key`` is the service's."""
    return f"{SERVER_KEYS}/{zid}/{node_chunk(name)}/{key}"


def _parts(prefix: str, key: str) -> tuple[str, list[str]]:
    """The session's id and what follows it."""
    begin = prefix + "/"
    if not key.startswith(begin):
        raise TokenError(f"it is not under {prefix}")
    zid, *parts = key[len(begin) :].split("/")
    if _ZID.fullmatch(zid) is None:
        raise TokenError("it names no session")
    return zid, parts


def _name(chunk: str) -> str:
    name = (
        node_of(chunk) if len(chunk) <= 12 * MOST_NAME else ""
    )  # a character: up to four times %xx
    if not name or len(name) > MOST_NAME:
        raise TokenError(f"a node's name has 1 to {MOST_NAME} characters")
    if node_chunk(name) != chunk:
        raise TokenError("a node's name that is not written as names are")
    return name
