"""What is concluded of one machine: conforming, violated, or not known; and what has to be said of it.

A violation that the judge finds is said as *violated* once nothing that is missing can be the reason. Both
halves of an oracle share this: the judge says here what it finds (``found``, ``unknown``, ``known``), and the
numbers of what is received tell when it is certain (``numbered``, ``reported``, ``gave_up``). So the judge
needs to know nothing of numbers.
"""

from __future__ import annotations

from moon.oracle.confirmation import Confirmation
from moon.oracle.unconfirmed import UNCONFIRMED, Unconfirmed, Violation
from moon.ordering.numbers import Place
from moon.verdict import Outcome, Verdict


class Conclusion:
    """The verdict on one machine, as it stands.

    Args:
        machine: its name.
        node: the node that runs it.
        confirmation: what would show that a violation is certain.

    Attributes:
        outcome: of the verdict.
        violations: how many were said.
        unconfirmed: those that are not certain yet.
    """

    __slots__ = (
        "_confirmation",
        "_machine",
        "_node",
        "_reason",
        "outcome",
        "unconfirmed",
        "violations",
    )

    def __init__(self, machine: str, node: str, confirmation: Confirmation) -> None:
        self.outcome = Outcome.CONFORMING
        self.violations = 0
        self.unconfirmed = Unconfirmed()
        self._confirmation = confirmation
        self._machine = machine
        self._node = node
        self._reason = ""

    def verdict(self, stamp_ns: int) -> Verdict:
        """The verdict as it stands at ``stamp_ns``."""
        return Verdict(self._machine, self._node, self.outcome, stamp_ns, self._reason)

    # --- what the judge finds ------------------------------------------------------------------------

    def found(self, violation: Violation) -> tuple[list[Verdict], bool]:
        """``violation`` was found.

        Returns:
            What is to be said now, and whether what the machine does is still known after it: it is not
            where something is missing that may explain it.
        """
        needed = self._confirmation.needed(violation)
        verdict = violation.verdict
        if needed is not None:
            if needed.is_over:
                return self._confirmed([verdict]), True
            self.unconfirmed.add(needed)
            if self.outcome is Outcome.VIOLATED:
                return [], True  # it is, whether this one is certain or not
        reason = f"{UNCONFIRMED}{verdict.reason}"
        if needed is None:
            reason = f"observations were lost; {reason}"
        return self.unknown(verdict.stamp_ns, reason, is_news=True), needed is not None

    def unknown(self, stamp_ns: int, reason: str, is_news: bool = False) -> list[Verdict]:
        """It is not known what the machine does.

        Args:
            stamp_ns: since when.
            reason: why, for people.
            is_news: whether that is the reason from now on where there is one already.
        """
        was_unknown = self.outcome is Outcome.INCONCLUSIVE
        if is_news or not was_unknown:
            self._reason = reason
        self.outcome = Outcome.INCONCLUSIVE
        return [] if was_unknown else [self.verdict(stamp_ns)]

    def known(self) -> None:
        """It is known what the machine does, and all that it did is what its model does."""
        if not self.unconfirmed.kept:
            self.outcome, self._reason = Outcome.CONFORMING, ""

    def restart(self) -> None:
        """The machine starts, in its initial state."""
        self.unconfirmed.restart()
        self.outcome, self._reason = Outcome.CONFORMING, ""

    def may_be_unheard(self, expected: list[Place], by_ns: int) -> bool:
        """Whether what is ``expected`` may have been sent by ``by_ns``, and its channel is not heard yet."""
        return self._confirmation.may_be_unheard(expected, by_ns)

    # --- what is received, and may confirm a violation -----------------------------------------------

    def numbered(self, place: Place, number: int, stamp_ns: int) -> list[Verdict]:
        """Something came with ``number`` at ``place``, and happened at ``stamp_ns``."""
        return self._confirmed(self.unconfirmed.hear(place, number, stamp_ns))

    def reported(self, until_ns: int, gap_ns: int) -> list[Verdict]:
        """All that the node did until ``until_ns`` was received but what happened before ``gap_ns``."""
        return self._confirmed(self.unconfirmed.reported(until_ns, gap_ns))

    def counts_per_channel(self) -> list[Verdict]:
        """The node does not number all that it reports."""
        return self._confirmed(self.unconfirmed.counts_per_channel())

    def gave_up(self, call: tuple[str, int], stamp_ns: int) -> list[Verdict]:
        """The client of ``call`` had no answer when it gave up at ``stamp_ns``."""
        return self._confirmed(self.unconfirmed.gave_up(call, stamp_ns))

    def _confirmed(self, verdicts: list[Verdict]) -> list[Verdict]:
        """Say ``verdicts``, for which nothing can be missing."""
        if verdicts:
            self.violations += len(verdicts)
            self.outcome = Outcome.VIOLATED
            self._reason = verdicts[-1].reason
        return verdicts
