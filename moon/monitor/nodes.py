"""The nodes that run monitored machines: what is known of each, and how its machine stands."""

from __future__ import annotations

import statistics
from collections import deque

from moon.monitor.status import AWAY, UNSEEN, MachineStatus
from moon.oracle.oracle import Oracle
from moon.policy.oracle import PolicyOracle
from moon.verdict import MIDDLE, Outcome, Pattern, Verdict
from transports.bounded import BoundedDict

_KEPT_LAGS = 64
"""Lags kept of each node, for the median."""


class WatchedNode:
    """A node that runs a monitored machine."""

    def __init__(self) -> None:
        self.up = False
        self.gone_ns: int | None = None
        """When it went away, while it is away."""
        self.since = 0
        self.received_ns = 0
        """When the newest happened that was received from it while it was not up; 0: nothing was."""
        self.reported: Outcome | None = None
        self.last = ""
        self.violations = 0
        self.resynchronising = ""
        """Why all machines are resynchronised, until this one is."""
        self.was_reported: Outcome | None = None
        self.was_last = ""
        """``reported`` and ``last`` as they were before it was resynchronised."""
        self._violated: BoundedDict[Pattern, None] = BoundedDict(_KEPT_PATTERNS)
        """What was reported of it since it was last found to conform."""
        self._suspected: BoundedDict[Pattern, None] = BoundedDict(_KEPT_PATTERNS)
        """What it was suspected of since it was last found to conform."""
        self._why_violated = ""
        """The last violation, repetitions included."""
        self.lags: deque[int] = deque(maxlen=_KEPT_LAGS)
        self.earlier = (0, 0, 0)
        """Inputs, outputs and what was late of the oracles that it had before its present one."""

    @property
    def is_seen(self) -> bool:
        """Whether anything is known of it; what others send to it tells nothing of it."""
        return self.up or self.reported is not None or bool(self.lags)

    def suspects(self, violation: Verdict | None) -> bool:
        """Whether ``violation``, which is not certain yet, is like none that it was suspected of before."""
        return violation is not None and not _is_known(self._suspected, violation.pattern)

    def repeats(self, violation: Verdict) -> bool:
        """Whether ``violation`` is like one that was reported since the machine last conformed."""
        self._why_violated = violation.reason
        known = _is_known(self._violated, violation.pattern)
        return known and self.reported is Outcome.VIOLATED

    def resynchronise(self, oracle: Oracle | PolicyOracle, why: str) -> None:
        """Another oracle takes the place of ``oracle``, as all are resynchronised: ``why``, for people."""
        if not self.resynchronising:
            self.was_reported, self.was_last = self.reported, self.last
        self.resynchronising = why
        inputs, outputs, late = self.earlier
        self.earlier = (inputs + oracle.inputs, outputs + oracle.outputs, late + oracle.late)

    def report(self, verdict: Verdict) -> bool:
        """``verdict`` is news; whether it is so to a person, too.

        That a machine is inconclusive as all are resynchronised, and then as it was before, is not.
        """
        self.reported = verdict.outcome
        if verdict.outcome is Outcome.CONFORMING:
            self._suspected.clear()
            self._violated.clear()
        if verdict.reason:
            self.last = verdict.reason
        if not self.resynchronising or verdict.reason == self.resynchronising:
            return not self.resynchronising
        self.resynchronising = ""
        both = (verdict.outcome, self.was_reported)
        return both != (Outcome.CONFORMING, Outcome.CONFORMING)

    def end(self, now_ns: int) -> bool:
        """It went away; whether it conforms, which was inconclusive.

        A machine that is resynchronised is found to conform whatever was missed of it. All that is unknown
        until then is its present state, and who has ended has none: the verdict of before stands.
        """
        self.up, self.received_ns, self.gone_ns = False, 0, now_ns
        if self.reported is not Outcome.INCONCLUSIVE or not self.resynchronising:
            return False
        self.reported, self.last = self.was_reported, self.was_last
        return self.reported is Outcome.CONFORMING

    def late(self, oracle: Oracle | PolicyOracle) -> int:
        """What came too late to be judged by ``oracle`` and those before it."""
        return self.earlier[2] + oracle.late

    def standing(self, oracle: Oracle | PolicyOracle) -> tuple[str, tuple[str, ...]]:
        """Verdict and states of its machine as it is now, whatever it did before."""
        if self.gone_ns is not None:
            return str(self.reported or UNSEEN), (AWAY,)
        return self._verdict(oracle), tuple(oracle.states()) if self.is_seen else ()

    def _verdict(self, oracle: Oracle | PolicyOracle) -> str:
        """That of its machine; nothing is known of one that was found in the middle, and silent since."""
        if not self.is_seen:
            return UNSEEN
        is_new = self.reported is None and oracle.outcome is Outcome.CONFORMING
        return str(Outcome.INCONCLUSIVE if is_new and not oracle.hypotheses else oracle.outcome)

    def status(self, name: str, oracle: Oracle | PolicyOracle) -> MachineStatus:
        """Its machine's row, with all that it ever did."""
        inputs, outputs, _ = self.earlier
        verdict = self._verdict(oracle)
        states = tuple(oracle.states())
        if self.gone_ns is not None:
            verdict, states = str(self.reported or UNSEEN), (AWAY,)
        if self.violations and oracle.outcome is Outcome.CONFORMING:
            verdict = str(Outcome.VIOLATED)
        why = MIDDLE if verdict == Outcome.INCONCLUSIVE else ""
        return MachineStatus(
            name,
            verdict,
            states,
            inputs + oracle.inputs,
            outputs + oracle.outputs,
            self.violations,
            self.late(oracle),
            statistics.median(self.lags) / 1e6 if self.lags else None,
            self._why_violated if verdict == Outcome.VIOLATED else self.last or why,
        )


_KEPT_PATTERNS = 64
"""So many kinds of violations of one node are told from one another; the oldest is news again."""


def _is_known(patterns: BoundedDict[Pattern, None], pattern: Pattern) -> bool:
    """Whether ``pattern`` is among ``patterns``; it is from now on."""
    if pattern in patterns:
        return True
    patterns[pattern] = None
    return False
