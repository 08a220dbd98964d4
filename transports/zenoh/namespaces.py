"""Listening to the systems of many namespaces over one session, which has no namespace itself.

Nodes whose session has the option ``namespace`` put it before all of their keys, those of their liveliness
tokens and answers too. So a system is found by the tokens of its nodes, and what listens to it puts the
namespace before the keys that it declares and takes it from those that come.
"""

# zenoh's stubs leave the results of some methods open
# mypy: disable-error-code="no-untyped-call"

from __future__ import annotations

import logging
import time
from collections.abc import Callable, MutableMapping, Sequence
from typing import Any

import msgspec
import zenoh

from transports.interface import Observation, Topic
from transports.options import MOST_NAMESPACE
from transports.refusals import Refusals
from transports.timers import Timer
from transports.zenoh import presence, tokens, topics
from transports.zenoh.contained import Contained
from transports.zenoh.executor import Executor
from transports.zenoh.idle import IdleTaps
from transports.zenoh.names import NODE_KEYS
from transports.zenoh.orders import Orders
from transports.zenoh.permissions import Permissions
from transports.zenoh.tap import Tap
from transports.zenoh.tokens import NodeToken, TokenError
from transports.zenoh.wire import LOG

RING_CAPACITY = 4096
"""Messages of one namespace that Zenoh keeps until they are taken: 20 s of the lab tour at five ticks a
second. They take 1 MB; those of a tap that is alone take 16."""
MOST_NAMESPACES = 10_000
"""Namespaces that are distinguished at once; anybody may announce nodes in any number of them."""

_TOKENS = f"/{NODE_KEYS}/"


class _Present:
    """Which namespaces have nodes that are up."""

    def __init__(self) -> None:
        self._nodes: dict[str, set[NodeToken]] = {}

    def update(self, key: str, up: bool) -> tuple[str, bool] | None:
        """Take in a token's ``key``; ``(namespace, up)`` if the namespace is new or gone by that.

        Raises:
            TokenError: it is no token of a node, or there are more than are remembered.
        """
        namespace, _, rest = key.partition(_TOKENS)
        if len(namespace) > MOST_NAMESPACE:
            raise TokenError(f"a namespace of more than {MOST_NAMESPACE} characters")
        if not namespace.isprintable():
            raise TokenError("a namespace with characters that cannot be seen")
        token = tokens.read_node(f"{NODE_KEYS}/{rest}")
        there = self._nodes.get(namespace)
        if not up:
            if there is None or token not in there:
                return None
            there.discard(token)
            if there:
                return None
            del self._nodes[namespace]
            return namespace, False
        if there is not None:
            if len(there) >= presence.MOST_TOKENS:
                raise TokenError(f"more than {presence.MOST_TOKENS} nodes are up")
            there.add(token)
            return None
        if len(self._nodes) >= MOST_NAMESPACES:
            raise TokenError(f"more than {MOST_NAMESPACES} namespaces")
        self._nodes[namespace] = {token}
        return namespace, True


def watch_namespaces(
    session: zenoh.Session,
    executor: Executor,
    pattern: str,
    handler: Callable[[str, bool], None],
    refusals: Refusals,
) -> Any:
    """See ``transports.interface.Namespaces``; returns what must be undeclared."""
    present = _Present()

    def receive(sample: zenoh.Sample) -> None:
        try:
            change = present.update(str(sample.key_expr), presence.is_up(sample))
        except TokenError as error:
            refusals.refuse(NODE_KEYS, "", error)
            return
        if change is not None:
            handler(*change)

    put = executor.put
    key = f"{_key_expression(pattern)}{_TOKENS}**"
    return presence.watch(session, key, lambda sample: put((receive, sample)))


def _key_expression(pattern: str) -> str:
    """Zenoh writes ``$*`` for a part of a chunk."""
    return "/".join(
        chunk if chunk == "*" else chunk.replace("*", "$*") for chunk in pattern.split("/")
    )


class _Named(logging.LoggerAdapter[logging.Logger]):
    """Says of which namespace it is."""

    def __init__(self, namespace: str) -> None:
        super().__init__(LOG, {})
        self._begin = f"{namespace}: ".replace("%", "%%")

    def process(
        self, msg: Any, kwargs: MutableMapping[str, Any]
    ) -> tuple[Any, MutableMapping[str, Any]]:
        return self._begin + msg, kwargs


class Within:
    """A listener to the system of one namespace; see ``transports.interface.Listener`` for every method.

    Args:
        session: shared, without a namespace.
        executor: shared.
        node: who listens.
        namespace: whose system.
        failed: gets what a handler raised; nothing is run for this listener then.
        closed: called with this once it is closed.
        permissions: what whose certificate allows, where certificates are in use.
        idle: shared; waits for the first message.
    """

    repair_s: float = 0.0

    def __init__(
        self,
        session: zenoh.Session,
        executor: Executor,
        node: str,
        namespace: str,
        failed: Callable[[Exception], None],
        closed: Callable[[Within], None],
        permissions: Permissions | None = None,
        idle: IdleTaps | None = None,
    ) -> None:
        self.node = node
        self._session = session
        self._namespace = namespace
        self._permissions = permissions
        self._idle = idle
        self._runner = runner = Contained(executor, failed)
        self._closed = closed
        self._refusals = Refusals(_Named(namespace))
        self._orders = Orders(session.new_timestamp)
        self._up_since: dict[str, int] = {}
        self._taps: list[Tap] = []
        self._declared: list[Any] = []
        self._is_closed = False
        self.post = runner.post
        self.after: Callable[[float, Callable[[], None]], Timer] = runner.after
        self.every: Callable[[float, Callable[[], None]], Timer] = runner.every

    def now_ns(self) -> int:
        """The system's clock, ns since the epoch."""
        return time.time_ns()

    def publisher(self, topic: Topic) -> topics.Publisher:
        """Declare a publisher of a channel of this namespace."""
        place = msgspec.structs.replace(topic, name=f"/{self._namespace}{topic.name}")
        publisher = topics.Publisher(
            self._session, place, self.node.encode(), topics.Sequence(), self._orders
        )
        self._declared.append(publisher.declared)
        return publisher

    def watch_nodes(self, handler: Callable[[str, bool], None]) -> None:
        """``handler(name, up)`` whenever a node of this namespace announces itself or goes away."""
        self._declared.append(
            presence.watch_nodes(
                self._session,
                self._runner,
                self._up_since,
                handler,
                self._refusals,
                f"{self._namespace}/",
            )
        )

    def up_since(self, name: str) -> int:
        """When ``name``, which is being watched, began to connect (ns); 0 if not known."""
        return self._up_since.get(name, 0)

    def tap(self, channels: Sequence[str], handler: Callable[[Observation], None]) -> Tap:
        """Receive everything of this namespace on channels that match one of the globs (empty: all)."""
        tap = Tap(
            self._session,
            self._runner,
            self.node,
            channels,
            handler,
            self._refusals,
            self._namespace,
            RING_CAPACITY,
            self._permissions,
            self._idle,
        )
        self._taps.append(tap)
        return tap

    def close(self) -> None:
        """Listen no more; idempotent. What others have on this session stays."""
        if self._is_closed:
            return
        self._is_closed = True
        self._runner.close()
        for tap in self._taps:
            tap.close()
        for declared in self._declared:
            declared.undeclare()
        self._closed(self)
