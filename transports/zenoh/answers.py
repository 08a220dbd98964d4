"""Up to where a node has reported everything: a tap asks (``Tap.ask``), the node answers.

The question is a query to a key of the node's own session. The node answers on a thread of Zenoh's, so that
it does although its executor is busy: it sends what it keeps and then the answer, which comes on the same
link behind all that. The answer's time stamp is the moment up to which it holds, its attachment says the
number, and what the node's clock shows.

On the tap's side what came before lies in Zenoh's rings when the answer is there. A mark is put into each
ring, from this session to itself; when all of them have come out, and what was before them has been handled,
the answer is given.
"""

# zenoh's stubs leave the results of some methods open
# mypy: disable-error-code="no-untyped-call"

from __future__ import annotations

import contextlib
import secrets
from collections.abc import Callable, Collection
from typing import Any

import zenoh

from transports.interface import Answer
from transports.refusals import Refusals
from transports.timers import Timer
from transports.zenoh.names import ANSWER_KEYS
from transports.zenoh.orders import Orders
from transports.zenoh.tokens import MOST_NS, answer_key
from transports.zenoh.wire import attachment, life_of, read_attachment
from transports.zenoh_link.contained import Runner

MARK = "_m2c_mark"
"""The last part of the keys on which a session puts marks, for itself."""
_MARK_BYTES = 16
_GRACE_S = 1.0
"""Zenoh's own time limit comes this much after ours: it only frees what a lost question holds."""


class _AnswerError(Exception):
    """What came is no answer; the text says why."""


def answer(session: zenoh.Session, node: str, orders: Orders, flush: Callable[[], None]) -> Any:
    """Answer, from now on, whoever asks how far ``node`` has reported. Returns what must be undeclared.

    Args:
        session: the node's.
        node: its name.
        orders: numbers all that it does.
        flush: sends all events that are kept.
    """
    key = answer_key(str(session.info.zid()), node)
    name = node.encode()

    def reply(query: zenoh.Query) -> None:
        stamp, order = orders.reported()
        clock_ns = orders.clock_ns()
        flush()
        with contextlib.suppress(zenoh.ZError):  # who asked is gone, or this session
            query.reply(key, b"", timestamp=stamp, attachment=attachment(clock_ns, order, name))
        query.drop()

    return session.declare_queryable(
        key, zenoh.handlers.Callback(reply, indirect=False), complete=True
    )


class _Question:
    __slots__ = ("answer", "answered", "batch", "marks", "node", "timer", "token", "zid")

    def __init__(self, node: str, zid: str, answered: Callable[[Answer | None], None]) -> None:
        self.node = node
        self.zid = zid
        self.answered: Callable[[Answer | None], None] | None = answered
        self.timer: Timer | None = None
        self.answer: Answer | None = None
        self.token = b""
        self.marks = 0
        """Rings whose mark has not come out."""
        self.batch = 0
        """Handled up to this one, the tap has received all that came before the answer."""


class Questions:
    """What one tap has asked. All but ``ask`` and ``note_mark`` is called on the executor.

    Args:
        session: the tap's.
        executor: the tap's.
        subscribed: the key expressions of the tap's subscribers, each with a ring of its own.
        is_right: whether what is stamped by a session may be from a node (``Claims.is_right``).
        handled: how many batches the tap has handled.
        refusals: where what is no answer is counted.
        prefix: of the keys of those who are asked, where they have a namespace and the session has none.
    """

    def __init__(
        self,
        session: zenoh.Session,
        executor: Runner,
        subscribed: Collection[str],
        is_right: Callable[[str, object], bool],
        handled: Callable[[], int],
        refusals: Refusals,
        prefix: str = "",
    ) -> None:
        self._session = session
        self._executor = executor
        self._prefix = prefix
        self._is_right = is_right
        self._handled = handled
        self._refusals = refusals
        self._mark_keys = [key.removesuffix("**") + MARK for key in subscribed]
        self._marked: dict[bytes, _Question] = {}
        self._due: list[_Question] = []
        self._closed = False

    def ask(
        self, node: str, zid: str, answered: Callable[[Answer | None], None], within_s: float
    ) -> None:
        """Ask ``node`` of session ``zid``; if that is empty, there is nobody to ask."""
        question = _Question(node, zid, answered)
        self._executor.put((self._send, (question, within_s)))

    def note_mark(self, token: bytes, batch: int) -> None:
        """A mark has come out of a ring; what came before is in batches up to number ``batch``."""
        if token in self._marked:
            self._executor.put((self._pass, (token, batch)))

    def give(self) -> None:
        """Give the answers before which all has been handled."""
        if not self._due:
            return
        handled = self._handled()
        given = [question for question in self._due if question.batch <= handled]
        self._due = [question for question in self._due if question.batch > handled]
        for question in given:
            self._end(question, question.answer)

    def close(self) -> None:
        """Give no more answers; from any thread."""
        self._closed = True

    def _send(self, item: tuple[_Question, float]) -> None:
        question, within_s = item
        if not question.zid or self._closed:
            self._end(question, None)
            return
        put = self._executor.put
        question.timer = self._executor.after(within_s, lambda: self._end(question, None))
        try:
            came: Any = zenoh.handlers.Callback(
                lambda reply: put((self._take, (question, reply))),
                lambda: put((self._none_came, question)),
                indirect=False,
            )
            self._session.get(
                self._prefix + answer_key(question.zid, question.node),
                came,
                timeout=within_s + _GRACE_S,
                consolidation=zenoh.ConsolidationMode.NONE,
            )
        except zenoh.ZError:  # this session is closed
            self._end(question, None)

    def _none_came(self, question: _Question) -> None:
        if question.answer is None:
            self._end(question, None)

    def _take(self, item: tuple[_Question, zenoh.Reply]) -> None:
        question, reply = item
        if question.answered is None or question.answer is not None:
            return  # it came too late, or is a second one
        try:
            question.answer = self._read(question.node, question.zid, reply)
        except _AnswerError as error:
            self._refusals.refuse(ANSWER_KEYS, question.node, error)
            self._end(question, None)
            return
        question.token = secrets.token_bytes(_MARK_BYTES)
        question.marks = len(self._mark_keys)
        self._marked[question.token] = question
        for key in self._mark_keys:
            self._session.put(
                key,
                b"",
                attachment=question.token,
                allowed_destination=zenoh.Locality.SESSION_LOCAL,
            )

    def _read(self, node: str, zid: str, reply: zenoh.Reply) -> Answer:
        sample = reply.ok
        if sample is None:
            raise _AnswerError("an error instead of an answer")
        if str(sample.key_expr) != self._prefix + answer_key(zid, node):
            raise _AnswerError("it comes from another key than was asked")
        sent = read_attachment(sample.attachment)
        if sent.order < 0 or sent.node != node:
            raise _AnswerError("it does not say which node it is from and how far it has reported")
        stamp = sample.timestamp
        if stamp is None or not self._is_right(node, stamp.get_id()):
            raise _AnswerError("it has the stamp of another session, or none")
        # what comes next may have been stamped within the same nanosecond
        stamp_ns = int(stamp.get_time_as_ntp64().as_nanos()) - 1
        if not 0 <= stamp_ns <= MOST_NS:
            raise _AnswerError("its stamp is no number of ns since the epoch")
        return Answer(stamp_ns, sent.order, sent.number, life=life_of(stamp.get_id()))

    def _pass(self, mark: tuple[bytes, int]) -> None:
        token, batch = mark
        question = self._marked.get(token)
        if question is None:
            return
        question.batch = max(question.batch, batch)
        question.marks -= 1
        if not question.marks:
            self._due.append(question)
            self.give()

    def _end(self, question: _Question, answer: Answer | None) -> None:
        answered, question.answered = question.answered, None
        self._marked.pop(question.token, None)
        if question.timer is not None:
            question.timer.cancel()
        if answered is not None and not self._closed:
            answered(answer)
