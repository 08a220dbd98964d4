"""Who is there: liveliness tokens of nodes, of servers, and of what each node hears.

Zenoh withdraws a token when its session closes or its link breaks, so a killed node disappears
by itself. Peers do not relay tokens for one another; therefore each node also declares which
nodes it hears (``LINK_KEYS``), from which a tap learns of nodes that it is not linked to itself.
"""

# zenoh's stubs leave the results of some methods open
# mypy: disable-error-code="no-untyped-call"

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable, Sequence
from queue import Empty, SimpleQueue
from typing import Any

import msgspec
import zenoh

from transports.zenoh.executor import Executor
from transports.zenoh.names import (
    LINK_KEYS,
    NODE_KEYS,
    SERVER_KEYS,
    channel_of,
    key_of,
    node_chunk,
    node_of,
)
from transports.zenoh.wire import LOG


class Token(msgspec.Struct, frozen=True):
    """A liveliness token that appeared or went away.

    Attributes:
        zid: the id of the session that declared it.
        rest: the parts of its key after the id.
        up: whether it is there.
    """

    zid: str
    rest: tuple[str, ...]
    up: bool


def read_token(prefix: str, sample: zenoh.Sample) -> Token:
    """The token under ``prefix`` that ``sample`` tells of."""
    zid, *rest = str(sample.key_expr).removeprefix(prefix + "/").split("/")
    return Token(zid, tuple(rest), sample.kind == zenoh.SampleKind.PUT)


def watch(session: zenoh.Session, pattern: str, receive: Callable[[zenoh.Sample], object]) -> Any:
    """Call ``receive`` (on a Zenoh thread: it must only enqueue) for each token matching
    ``pattern`` that is there, appears or goes away. Returns what must be undeclared.
    """
    return session.liveliness().declare_subscriber(
        pattern, zenoh.handlers.Callback(receive, indirect=False), history=True
    )


class Nodes:
    """The nodes that are up, by name; a restarted node may be there twice for a moment."""

    def __init__(self, since: dict[str, int] | None = None) -> None:
        self.sessions: dict[str, set[str]] = {}
        self.since = {} if since is None else since
        """When the newest session of each began to connect, as it says itself (ns)."""

    def update(self, token: Token) -> tuple[str, bool] | None:
        """Take a token of NODE_KEYS in; ``(name, up)`` if that changed who is up."""
        if not token.rest:
            return None
        name = node_of(token.rest[0])
        sessions = self.sessions.setdefault(name, set())
        was_up = bool(sessions)
        (sessions.add if token.up else sessions.discard)(token.zid)
        if token.up and len(token.rest) > 1 and token.rest[1].isdecimal():
            self.since[name] = max(self.since.get(name, 0), int(token.rest[1]))
        is_up = bool(sessions)
        if not is_up:
            del self.sessions[name]
            self.since.pop(name, None)
        return (name, is_up) if was_up != is_up else None


def wait_for_nodes(session: zenoh.Session, names: Iterable[str], timeout_s: float) -> list[str]:
    """Wait until all ``names`` are up; those still missing after ``timeout_s``."""
    wanted = list(names)
    deadline = time.monotonic() + timeout_s
    samples: SimpleQueue[zenoh.Sample] = SimpleQueue()
    subscriber = watch(session, f"{NODE_KEYS}/**", samples.put)
    nodes = Nodes()
    try:
        while missing := [name for name in wanted if name not in nodes.sessions]:
            try:
                sample = samples.get(timeout=max(deadline - time.monotonic(), 0.0))
            except Empty:
                return missing
            nodes.update(read_token(NODE_KEYS, sample))
        return []
    finally:
        subscriber.undeclare()


def watch_nodes(
    session: zenoh.Session,
    executor: Executor,
    since: dict[str, int],
    handler: Callable[[str, bool], None],
) -> Any:
    """``handler(name, up)`` on the executor; returns what must be undeclared.

    ``since`` is kept up to date: when each node that is up began to connect.
    """
    nodes = Nodes(since)

    def receive(sample: zenoh.Sample) -> None:
        if change := nodes.update(read_token(NODE_KEYS, sample)):
            handler(*change)

    put = executor.put
    return watch(session, f"{NODE_KEYS}/**", lambda sample: put((receive, sample)))


class Announcement:
    """A node's own token, the list of nodes it hears, and a watch for its name taken twice.

    The token says when the node began to connect (``since_ns``), so that who learns of it late, over
    a link that came up late or again, does not take it for one that has just started.
    """

    def __init__(
        self, session: zenoh.Session, executor: Executor, node: str, since_ns: int
    ) -> None:
        self._session = session
        self._node = node
        self._zid = str(session.info.zid())
        self._nodes = Nodes()
        self._links: Any = None
        self._linked: Sequence[str] = ()
        self._withdrawn = False
        self._lock = threading.RLock()
        """Held while tokens come and go: each is withdrawn once."""
        put, receive = executor.put, self._receive
        self._watch = watch(session, f"{NODE_KEYS}/**", lambda sample: put((receive, sample)))
        self._token = session.liveliness().declare_token(
            f"{NODE_KEYS}/{self._zid}/{node_chunk(node)}/{since_ns}"
        )

    def _receive(self, sample: zenoh.Sample) -> None:
        token = read_token(NODE_KEYS, sample)
        change = self._nodes.update(token)
        if token.up and token.zid != self._zid and token.rest[0] == node_chunk(self._node):
            LOG.error("two nodes are named %s: this one and session %s", self._node, token.zid)
        if change is None:
            return
        linked = sorted(node_chunk(n) for n in self._nodes.sessions if n != self._node)
        if linked == self._linked:
            return
        self._linked = linked
        with self._lock:
            if self._withdrawn:
                return
            before = self._links
            try:
                self._links = self._session.liveliness().declare_token(
                    f"{LINK_KEYS}/{self._zid}/{','.join(linked) or '-'}"
                )
                if before is not None:
                    before.undeclare()
            except zenoh.ZError:
                if not self._withdrawn:  # by a signal's handler on this thread, meanwhile
                    raise

    def undeclare(self) -> None:
        """Withdraw; from any thread."""
        with self._lock:
            self._withdrawn = True
            for declared in (self._watch, self._token, self._links):
                if declared is not None:
                    declared.undeclare()


class ServerToken:
    """Says that this node serves a service, and reports another node that serves it too."""

    def __init__(self, session: zenoh.Session, executor: Executor, node: str, service: str) -> None:
        self._node = node
        self._zid = str(session.info.zid())
        key = key_of(service)
        put, receive = executor.put, self._receive
        self._watch = watch(
            session, f"{SERVER_KEYS}/*/*/{key}", lambda sample: put((receive, sample))
        )
        self._token = session.liveliness().declare_token(
            f"{SERVER_KEYS}/{self._zid}/{node_chunk(node)}/{key}"
        )

    def _receive(self, sample: zenoh.Sample) -> None:
        token = read_token(SERVER_KEYS, sample)
        if token.up and token.zid != self._zid:
            LOG.error(
                "two nodes serve %s: %s and %s; a call reaches only one of them",
                channel_of("/".join(token.rest[1:])),
                self._node,
                node_of(token.rest[0]),
            )

    def undeclare(self) -> None:
        """Withdraw."""
        self._watch.undeclare()
        self._token.undeclare()
