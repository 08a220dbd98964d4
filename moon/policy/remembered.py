"""Runs of a plain tree, by what its tree was seen to do: it is asked only what it was not asked before.

A plain tree remembers nothing from tick to tick but which leaf is RUNNING (``moon.policy.shape``), and
what it does within a tick follows from the answers that it got in it. So a run is a place among the
answers that were given so far; where it goes on from there is looked up. Only where nobody has been does
the tree itself go (``moon.policy.run``). A policy does few different things, again and again: after a
while nothing is ticked any more.
"""

from __future__ import annotations

from collections.abc import Sequence

from m2c.policy.program import Leaf
from moon.policy.run import BEGIN, Ask, AskKind, TreePath, TreeRun, Trees

MAX_MOMENTS = 20_000
"""So much is remembered (about 1 KB each); then all but the ends of ticks is found out anew."""

_ERROR = "ERROR"
_ANY = ""
"""What halts are answered is all the same."""


class Moment:
    """A tree that waits for an answer, in a certain tick.

    Attributes:
        ask: what it waits for.
        running: the leaves that are RUNNING, and how each is called.
        memory: those that were, when the tick began.
        key: two moments with equal keys go on alike.
        before: the moment before, and the answer that led from it to here; None: a fresh tree.
        after: where each answer leads, as far as that is known.
    """

    __slots__ = ("after", "ask", "before", "decided", "key", "memory", "running")

    def __init__(
        self, ask: Ask, running: dict[TreePath, Leaf], before: tuple[Moment, str] | None
    ) -> None:
        self.ask = ask
        self.running = running
        self.before = before
        self.after: dict[str, Moment] = {}
        self.memory: frozenset[TreePath] = frozenset()
        self.decided: tuple[TreePath, str] | None = None
        """Where the tree was answered last in this tick, halts aside, and what."""
        if before is not None:
            earlier, answer = before
            kind = earlier.ask.kind
            self.memory = frozenset(earlier.running) if kind is AskKind.END else earlier.memory
            if kind is not AskKind.END:
                halted = kind is AskKind.HALT
                self.decided = earlier.decided if halted else (earlier.ask.place, answer)
        # the same leaf may be halted for several reasons; the last answer decides which
        why = self.decided if ask.kind is AskKind.HALT else None
        self.key: object = (self.memory, ask.kind, ask.place, frozenset(running), why)


class RememberedTree:
    """What is remembered of the trees of one plain policy; all its runs share it.

    Args:
        trees: makes trees, where it has to be seen what they do.
    """

    def __init__(self, trees: Trees) -> None:
        self._trees = trees
        self._fresh = Moment(Ask(AskKind.END), {}, None)
        self._ends: dict[object, Moment] = {_end(self._fresh): self._fresh}
        """The moments between two ticks."""
        self._count = 0
        self._tree: TreeRun | None = None
        self._at = self._fresh
        """Where ``_tree`` stands."""

    def start(self) -> RememberedRun:
        """A run of a fresh tree."""
        return RememberedRun(self, self._fresh)

    def after(self, moment: Moment, answer: str) -> Moment:
        """Where ``answer`` leads from ``moment``, which was not computed so far."""
        if self._count >= MAX_MOMENTS:
            self._forget()
        tree = self._stand_at(moment)
        try:
            ask = tree.step(answer)
        except BaseException:
            self.close()
            raise
        found = Moment(ask, dict(tree.running), (moment, answer))
        if ask.kind is AskKind.END:
            found = self._ends.setdefault(_end(found), found)
        moment.after[answer] = found
        self._count += 1
        self._at = found
        return found

    def close(self) -> None:
        """End the tree and its thread; what is remembered stays."""
        if self._tree is not None:
            self._tree.close()
            self._tree = None

    def _stand_at(self, moment: Moment) -> TreeRun:
        """A tree that is where ``moment`` is."""
        if self._tree is not None and self._at is moment:
            return self._tree
        self.close()
        steps = []
        before = moment.before
        while before is not None:
            steps.append(before[1])
            before = before[0].before
        self._tree = TreeRun(self._trees)
        self._tree.follow(steps[::-1])
        self._at = moment
        return self._tree

    def _forget(self) -> None:
        """Forget what ticks were like; there are few ways to end one, and each has a short way there."""
        for end in self._ends.values():
            end.after.clear()
        self._count = 0


class RememberedRun:
    """One run; as :class:`moon.policy.run.TreeRun`, without a tree of its own.

    Attributes:
        due_ns: the tree is not ticked again before.
    """

    __slots__ = ("_moment", "_of", "due_ns")

    def __init__(self, of: RememberedTree, moment: Moment) -> None:
        self._of = of
        self._moment = moment
        self.due_ns = 0

    @property
    def ask(self) -> Ask:
        """What it waits for."""
        return self._moment.ask

    @property
    def running(self) -> dict[TreePath, Leaf]:
        """The leaves that are RUNNING, and how each is called."""
        return self._moment.running

    @property
    def key(self) -> object:
        """Two runs go on alike if this is equal."""
        return self._moment.key

    def step(self, answer: str) -> Ask:
        """Answer ``ask`` and go on to the next one."""
        moment = self._moment
        if moment.ask.kind is AskKind.HALT:
            answer = _ANY
        elif moment.ask.kind is AskKind.END:
            answer = BEGIN
        found = moment.after.get(answer)
        if found is None:
            found = self._of.after(moment, answer)
        self._moment = found
        return found.ask

    def follow(self, steps: Sequence[str]) -> None:
        """Take ``steps``."""
        for step in steps:
            self.step(step)

    def fork(self) -> RememberedRun:
        """Another run that stands where this one stands."""
        other = RememberedRun(self._of, self._moment)
        other.due_ns = self.due_ns
        return other

    def close(self) -> None:
        """Nothing has to be ended."""


def _end(moment: Moment) -> object:
    """What a tree remembers at the end of a tick; one that could not go on is another one."""
    return frozenset(moment.running), moment.ask.status == _ERROR
