"""Listening to the systems of many namespaces over one session, which has no namespace itself.

Nodes whose session has the option ``namespace`` put it before all of their keys, those of their liveliness
tokens and answers too. So a system is found by the tokens of its nodes, and what listens to it puts the
namespace before the keys that it declares and takes it from those that come.
"""

# zenoh's stubs leave the results of some methods open
# mypy: disable-error-code="no-untyped-call"

from __future__ import annotations

import contextlib
import logging
import time
from collections.abc import Callable, MutableMapping, Sequence
from typing import Any

import msgspec
import zenoh

from transports.interface import Closes, Observation, Topic
from transports.options import MOST_NAMESPACE
from transports.refusals import Refusals
from transports.timers import Timer
from transports.zenoh import presence, tokens, topics
from transports.zenoh.idle import IdleTaps
from transports.zenoh.names import NODE_KEYS
from transports.zenoh.orders import Orders
from transports.zenoh.tap import Listener, Tap
from transports.zenoh.tokens import NodeToken, TokenError
from transports.zenoh_link.contained import Contained
from transports.zenoh_link.executor import Executor
from transports.zenoh_link.log import LOG

RING_CAPACITY = 4096
"""Messages of one namespace that Zenoh keeps until they are taken: 20 s of the lab tour at five ticks a
second. They take 1 MB; those of a tap that is alone take 16."""
MOST_NAMESPACES = 10_000
"""Namespaces that are distinguished at once; anybody may announce nodes in any number of them."""

ANSWER_S = 5.0
"""A node that is asked whether it is at work answers at once; this only frees what a lost question holds."""
SILENT_S = 0.5
"""Who has not answered after so long is listened to."""
SILENT_CAPACITY = 256
"""Messages of all namespaces that are kept for it: those that are at work are not waited for there."""

_TOKENS = f"/{NODE_KEYS}/"


class _Present:
    """Which namespaces have nodes that are up."""

    def __init__(self) -> None:
        self._nodes: dict[str, set[NodeToken]] = {}

    def update(self, namespace: str, token: NodeToken, up: bool) -> bool:
        """Take in that ``token`` is there or no longer; whether ``namespace`` is new or gone by that.

        Raises:
            TokenError: there are more than are remembered.
        """
        there = self._nodes.get(namespace)
        if not up:
            if there is None or token not in there:
                return False
            there.discard(token)
            if there:
                return False
            del self._nodes[namespace]
            return True
        if there is not None:
            if len(there) >= presence.MOST_TOKENS:
                raise TokenError(f"more than {presence.MOST_TOKENS} nodes are up")
            there.add(token)
            return False
        if len(self._nodes) >= MOST_NAMESPACES:
            raise TokenError(f"more than {MOST_NAMESPACES} namespaces")
        self._nodes[namespace] = {token}
        return True


def _read(key: str) -> tuple[str, NodeToken]:
    """The namespace and the node of a token; TokenError if it is none."""
    namespace, _, rest = key.partition(_TOKENS)
    if len(namespace) > MOST_NAMESPACE:
        raise TokenError(f"a namespace of more than {MOST_NAMESPACE} characters")
    if not namespace.isprintable():
        raise TokenError("a namespace with characters that cannot be seen")
    return namespace, tokens.read_node(f"{NODE_KEYS}/{rest}")


class NamespaceWatch:
    """Reports the namespaces in which somebody is at work; see ``transports.interface.Namespaces``.

    A token says that a node is up. Anybody may declare any number of them, and whoever listens to each of
    those namespaces pays for it, as all do who publish. So each node is asked how far it has reported, which
    nodes answer at once; and what is silent is listened to by one subscriber for all. All but the
    constructor runs on the executor.

    Args:
        session: without a namespace.
        executor: of the transport.
        pattern: of namespaces.
        handler: gets ``(namespace, up)``.
        refusals: where tokens that are none are counted.
        idle: waits for the first message.
    """

    def __init__(
        self,
        session: zenoh.Session,
        executor: Executor,
        pattern: str,
        handler: Callable[[str, bool], None],
        refusals: Refusals,
        idle: IdleTaps,
    ) -> None:
        self._session = session
        self._executor = executor
        self._key = _key_expression(pattern)
        self._depth = pattern.count("/") + 1
        self._handler = handler
        self._refusals = refusals
        self._idle = idle
        self._present = _Present()
        self._silent: set[str] = set()
        """Those in which nobody has answered, and nothing was published."""
        self._at_work: set[str] = set()
        self._listening: Any = None
        self._is_planned = False
        self._is_over = False
        put, receive = executor.put, self._receive
        self._watch = presence.watch(
            session, f"{self._key}{_TOKENS}**", lambda sample: put((receive, sample))
        )

    def _receive(self, sample: zenoh.Sample) -> None:
        up = presence.is_up(sample)
        try:
            namespace, token = _read(str(sample.key_expr))
            is_change = self._present.update(namespace, token, up)
        except TokenError as error:
            self._refusals.refuse(NODE_KEYS, "", error)
            return
        if not up:
            if is_change:
                self._gone(namespace)
            return
        if is_change:
            self._silent.add(namespace)
            self._plan()
        if namespace in self._silent:
            self._ask(namespace, token)

    def _gone(self, namespace: str) -> None:
        self._silent.discard(namespace)
        self._rest()
        if namespace in self._at_work:
            self._at_work.discard(namespace)
            self._handler(namespace, False)

    def _found(self, namespace: str) -> None:
        """Somebody is at work there."""
        if namespace in self._silent:
            self._silent.discard(namespace)
            self._rest()
            self._at_work.add(namespace)
            self._handler(namespace, True)

    def _ask(self, namespace: str, token: NodeToken) -> None:
        put, answered = self._executor.put, self._answered
        came: Any = zenoh.handlers.Callback(
            lambda reply: put((answered, (namespace, reply))), indirect=False
        )
        with contextlib.suppress(zenoh.ZError):  # this session is closed
            key = f"{namespace}/{tokens.answer_key(token.zid, token.name)}"
            self._session.get(key, came, timeout=ANSWER_S)

    def _answered(self, answer: tuple[str, zenoh.Reply]) -> None:
        namespace, reply = answer
        if reply.ok is not None:
            self._found(namespace)

    # --- who does not answer -----------------------------------------------------------------------

    def _plan(self) -> None:
        """Listen soon, if somebody is silent then."""
        if self._listening is None and not self._is_planned:
            self._is_planned = True
            self._executor.after(SILENT_S, self._listen)

    def _listen(self) -> None:
        self._is_planned = False
        if self._silent and self._listening is None and not self._is_over:
            ring: Any = zenoh.handlers.RingChannel(SILENT_CAPACITY)
            self._listening = self._session.declare_subscriber(f"{self._key}/**", ring)
            self._wait()

    def _wait(self) -> None:
        put, spoke = self._executor.put, self._spoke
        self._idle.add(self._listening.handler, lambda sample: put((spoke, sample)))

    def _spoke(self, sample: zenoh.Sample | None) -> None:
        """Something was published; what lies there, too, is looked at."""
        while sample is not None and self._listening is not None:
            self._found("/".join(str(sample.key_expr).split("/", self._depth)[: self._depth]))
            if self._listening is not None:
                sample = self._listening.handler.try_recv()
        if self._listening is not None:
            self._wait()

    def _rest(self) -> None:
        """Nobody is silent any more: nothing more is to be listened for."""
        if not self._silent and self._listening is not None:
            listening, self._listening = self._listening, None
            self._idle.remove(listening.handler)
            listening.undeclare()

    def undeclare(self) -> None:
        """Watch no more."""
        self._is_over = True
        self._silent.clear()
        self._rest()
        self._watch.undeclare()


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


class Within(Closes):
    """A listener to the system of one namespace; see ``transports.interface.Listener`` for every method.

    Args:
        listener: who listens, on a session without a namespace; its handlers run in ``Contained``.
        executor: shared.
        namespace: whose system.
        failed: gets what a handler raised; nothing is run for this listener then.
        closed: called with this once it is closed.
    """

    repair_s: float = 0.0

    def __init__(
        self,
        listener: Listener,
        executor: Executor,
        namespace: str,
        failed: Callable[[Exception], None],
        closed: Callable[[Within], None],
    ) -> None:
        self.node = listener.node
        self._session = session = listener.session
        self._namespace = namespace
        self._runner = runner = Contained(executor, failed)
        self._listener = listener._replace(executor=runner)
        self._closed = closed
        self._refusals = Refusals(_Named(namespace))
        self._orders = Orders(session.new_timestamp)
        self._known: dict[str, tokens.NodeToken] = {}
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
                self._known,
                handler,
                self._refusals,
                f"{self._namespace}/",
            )
        )

    def up_since(self, name: str) -> int:
        """When ``name``, which is being watched, began to connect (ns); 0 if not known."""
        token = self._known.get(name)
        return 0 if token is None else token.since_ns

    def clock_of(self, name: str) -> str:
        """See ``TellsClocks.clock_of``."""
        return presence.clock_of(self._known, name)

    def tap(self, channels: Sequence[str], handler: Callable[[Observation], None]) -> Tap:
        """Receive everything of this namespace on channels that match one of the globs (empty: all)."""
        tap = Tap(self._listener, channels, handler, self._refusals, self._namespace, RING_CAPACITY)
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
