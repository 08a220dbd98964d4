"""Who is there: liveliness tokens of nodes, of servers, and of the nodes that each node is linked to.

Zenoh withdraws a token when its session closes or its link breaks, so a killed node disappears
by itself. Peers do not relay tokens for one another; therefore each session also declares which
nodes it is linked to (``LINK_KEYS``), from which a tap learns of nodes that it is not linked to itself.
"""

# zenoh's stubs leave the results of some methods open
# mypy: disable-error-code="no-untyped-call"

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable, Mapping
from queue import Empty
from typing import Any

import zenoh

from transports import host
from transports.contested import Contested
from transports.refusals import Refusals, shown
from transports.work_queue import WorkQueue
from transports.zenoh import tokens
from transports.zenoh.names import NODE_KEYS, SERVER_KEYS, key_of
from transports.zenoh.tokens import NodeToken, TokenError
from transports.zenoh_link.contained import Runner
from transports.zenoh_link.executor import Executor
from transports.zenoh_link.log import LOG

MOST_TOKENS = 4096
"""Announcements of nodes that are remembered: anybody may declare any number of them."""
LINKS_PERIOD_S = 0.1
"""A node publishes at most so often which others it is linked to: each time to all of them."""
_MOST_TWINS = 16
"""So many others of the same name, or of the same service, are reported one by one."""


def is_up(sample: zenoh.Sample) -> bool:
    """Whether a token appeared; else it went away."""
    return sample.kind == zenoh.SampleKind.PUT


def watch(session: zenoh.Session, pattern: str, receive: Callable[[zenoh.Sample], object]) -> Any:
    """Call ``receive`` (on a Zenoh thread: it must only enqueue) for each token matching
    ``pattern`` that is there, appears or goes away. Returns what must be undeclared.
    """
    return session.liveliness().declare_subscriber(
        pattern, zenoh.handlers.Callback(receive, indirect=False), history=True
    )


class Nodes:
    """The nodes that are up, by name; a restarted node may be there twice for a moment."""

    def __init__(self, known: dict[str, NodeToken] | None = None) -> None:
        self.announced: dict[str, set[NodeToken]] = {}
        """What there is of each: one token, or somebody else says that it has this name, too."""
        self.known = {} if known is None else known
        """What each says of itself; nothing but its name of one that was there twice at once: which of the
        two something comes from is not known, and so not what it had done before."""
        self._count = 0
        self.contested = Contested()
        """Names that are there twice, or were of late."""

    def update(self, token: NodeToken, up: bool) -> tuple[str, bool] | None:
        """Take in that ``token`` is there or no longer; ``(name, up)`` if that changed who is up.

        Raises:
            TokenError: there are more of them than are remembered.
        """
        name = token.name
        there = self.announced.get(name, set())
        if up == (token in there):
            return None
        if not up:
            there.discard(token)
            self._count -= 1
            if len(there) == 1:
                self.contested.end(name)
            if there:
                return None
            del self.announced[name]
            self.known.pop(name, None)
            return name, False
        if self._count >= MOST_TOKENS:
            raise TokenError(f"more than {MOST_TOKENS} nodes are up")
        self._count += 1
        there.add(token)
        self.announced[name] = there
        if len(there) == 1:
            self.known[name] = token
        else:
            self.known[name] = NodeToken("", name)
            self.contested.begin(name)
        return (name, True) if len(there) == 1 else None

    def take(
        self, sample: zenoh.Sample, refusals: Refusals, prefix: str = ""
    ) -> tuple[str, bool] | None:
        """``update`` with what ``sample`` says, whose key begins with ``prefix``, or refuse it."""
        key = str(sample.key_expr).removeprefix(prefix)
        try:
            return self.update(tokens.read_node(key), is_up(sample))
        except TokenError as error:
            refusals.refuse(NODE_KEYS, "", error)
            return None


def wait_for_nodes(
    session: zenoh.Session, names: Iterable[str], timeout_s: float, refusals: Refusals
) -> list[str]:
    """Wait until all ``names`` are up; those still missing after ``timeout_s``."""
    wanted = list(names)
    deadline = time.monotonic() + timeout_s
    samples: WorkQueue[zenoh.Sample] = WorkQueue()
    subscriber = watch(session, f"{NODE_KEYS}/**", samples.put)
    nodes = Nodes()
    try:
        while missing := [name for name in wanted if name not in nodes.announced]:
            try:
                sample = samples.get(deadline - time.monotonic())
            except Empty:
                return missing
            nodes.take(sample, refusals)
        return []
    finally:
        subscriber.undeclare()


def clock_of(known: Mapping[str, NodeToken], name: str) -> str:
    """See ``TellsClocks.clock_of``; ``known``: what each node says of itself."""
    if not name:
        return host.clock_of(host.ID)
    return host.clock_of(known[name].host) if name in known else ""


def watch_nodes(
    session: zenoh.Session,
    executor: Runner,
    known: dict[str, NodeToken],
    handler: Callable[[str, bool], None],
    refusals: Refusals,
    prefix: str = "",
) -> Any:
    """``handler(name, up)`` on the executor; returns what must be undeclared.

    ``known`` is kept up to date: what each node that is up says of itself. ``prefix``: of the nodes' keys,
    where they have a namespace and the session has none.
    """
    nodes = Nodes(known)

    def receive(sample: zenoh.Sample) -> None:
        if change := nodes.take(sample, refusals, prefix):
            handler(*change)

    put = executor.put
    return watch(session, f"{prefix}{NODE_KEYS}/**", lambda sample: put((receive, sample)))


class _Twins:
    """Says who else there is that should not be, each once."""

    def __init__(self) -> None:
        self._known: set[str] = set()

    def are_new(self, who: str) -> bool:
        if who in self._known or len(self._known) >= _MOST_TWINS:
            return False
        self._known.add(who)
        return True


class Announcements:
    """What a session announces: its nodes, and which others it is linked to. It hears of names taken twice.

    A node's token says when the node began to connect (``since_ns``). Another node may learn of the token
    late, as their link came up late or again, and still knows that the node has not just started.
    """

    def __init__(self, session: zenoh.Session, executor: Executor, refusals: Refusals) -> None:
        self._session = session
        self._executor = executor
        self._zid = str(session.info.zid())
        self._refusals = refusals
        self._nodes = Nodes()
        self._twins = _Twins()
        self._own: dict[str, Any] = {}
        """The token of each node of this session."""
        self._watch: Any = None
        self._links: Any = None
        self._links_key = ""
        self._links_due_s = 0.0
        self._is_linking = False
        self._withdrawn = False
        self._lock = threading.RLock()
        """Held while tokens come and go: each is withdrawn once."""

    def add(self, node: str, since_ns: int) -> None:
        """``node``, of this session, is ready."""
        with self._lock:
            self._own[node] = None  # before anybody is heard
            if self._watch is None:
                put, receive = self._executor.put, self._receive
                self._watch = watch(
                    self._session, f"{NODE_KEYS}/**", lambda sample: put((receive, sample))
                )
            key = tokens.node_key(self._zid, node, since_ns, host.ID)
            self._own[node] = self._session.liveliness().declare_token(key)

    def remove(self, node: str) -> None:
        """``node`` ends, if it was ready; from any thread."""
        with self._lock:
            token = self._own.pop(node, None)
            if token is not None:
                token.undeclare()

    def _receive(self, sample: zenoh.Sample) -> None:
        try:
            token = tokens.read_node(str(sample.key_expr))
            change = self._nodes.update(token, is_up(sample))
        except TokenError as error:
            self._refusals.refuse(NODE_KEYS, "", error)
            return
        is_twin = token.name in self._own and token.zid != self._zid and is_up(sample)
        if is_twin and self._twins.are_new(token.zid):
            LOG.error("two nodes are named %s: this one and session %s", token.name, token.zid)
        if change is None or self._is_linking:
            return
        wait_s = self._links_due_s - time.monotonic()
        if wait_s <= 0:
            self._report_links()
        else:
            self._is_linking = True
            self._executor.after(wait_s, self._report_links)

    def _report_links(self) -> None:
        """Publish which nodes this session is linked to, if that has changed."""
        self._is_linking = False
        self._links_due_s = time.monotonic() + LINKS_PERIOD_S
        others = sorted(self._nodes.announced.keys() - self._own.keys())
        with self._lock:
            if self._withdrawn or not self._own:
                return
            key = tokens.links_key(self._zid, others, next(iter(self._own)))
            if key == self._links_key:
                return
            self._links_key = key
            before = self._links
            try:
                self._links = self._session.liveliness().declare_token(key)
                if before is not None:
                    before.undeclare()
            except zenoh.ZError:
                if not self._withdrawn:  # by a signal's handler on this thread, meanwhile
                    raise

    def undeclare(self) -> None:
        """Withdraw all; from any thread."""
        with self._lock:
            self._withdrawn = True
            for declared in (self._watch, *self._own.values(), self._links):
                if declared is not None:
                    declared.undeclare()


class ServerToken:
    """Says that this node serves a service, and reports another node that serves it too."""

    def __init__(
        self,
        session: zenoh.Session,
        executor: Executor,
        node: str,
        service: str,
        refusals: Refusals,
    ) -> None:
        self._node = node
        self._zid = str(session.info.zid())
        self._refusals = refusals
        self._twins = _Twins()
        key = key_of(service)
        put, receive = executor.put, self._receive
        self._watch = watch(
            session, f"{SERVER_KEYS}/*/*/{key}", lambda sample: put((receive, sample))
        )
        self._token = session.liveliness().declare_token(tokens.server_key(self._zid, node, key))

    def _receive(self, sample: zenoh.Sample) -> None:
        try:
            token = tokens.read_server(str(sample.key_expr))
        except TokenError as error:
            self._refusals.refuse(SERVER_KEYS, "", error)
            return
        is_twin = (token.zid, token.name) != (self._zid, self._node) and is_up(sample)
        if is_twin and self._twins.are_new(f"{token.zid}/{token.name}"):
            LOG.error(
                "two nodes serve %s: %s and %s; a call reaches only one of them",
                shown(token.service),
                self._node,
                shown(token.name),
            )

    def undeclare(self) -> None:
        """Withdraw."""
        self._watch.undeclare()
        self._token.undeclare()
