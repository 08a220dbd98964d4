"""The nodes that run monitored machines: what is known of each, and how its machine stands."""

from __future__ import annotations

import statistics
from collections import deque

from moon.monitor.status import UNSEEN, MachineStatus
from moon.oracle.confirmation import UNCONFIRMED
from moon.oracle.oracle import Oracle
from moon.policy.oracle import PolicyOracle
from moon.verdict import Outcome

_KEPT_LAGS = 64
"""Lags kept of each node, for the median."""

AWAY = "(gone)"
"""In place of the states of a machine whose node went away."""


class WatchedNode:
    """A node that runs a monitored machine."""

    __slots__ = (
        "earlier",
        "gone_ns",
        "lags",
        "last",
        "received",
        "reported",
        "since",
        "up",
        "violations",
    )

    def __init__(self) -> None:
        self.up = False
        self.gone_ns: int | None = None
        """When it went away, while it is away."""
        self.since = 0
        self.received = False
        """Whether something was received from it while it was not known to be up."""
        self.reported: Outcome | None = None
        self.last = ""
        self.violations = 0
        self.lags: deque[int] = deque(maxlen=_KEPT_LAGS)
        self.earlier = (0, 0, 0)
        """Inputs, outputs and what was late of the oracles that it had before its present one."""

    @property
    def is_seen(self) -> bool:
        """Whether anything is known of it; what others send to it tells nothing of it."""
        return self.up or self.reported is not None or bool(self.lags)

    def is_news(self, reason: str) -> bool:
        """Whether ``reason`` is a violation that is not certain yet, and was not reported."""
        return reason.startswith(UNCONFIRMED) and reason != self.last

    def leave(self, oracle: Oracle | PolicyOracle) -> None:
        """Another oracle takes the place of ``oracle``."""
        inputs, outputs, late = self.earlier
        self.earlier = (inputs + oracle.inputs, outputs + oracle.outputs, late + oracle.late)

    def late(self, oracle: Oracle | PolicyOracle) -> int:
        """What came too late to be judged by ``oracle`` and those before it."""
        return self.earlier[2] + oracle.late

    def standing(self, oracle: Oracle | PolicyOracle) -> tuple[str, tuple[str, ...]]:
        """Verdict and states of its machine as it is now, whatever it did before."""
        if self.gone_ns is not None:
            return str(self.reported or UNSEEN), (AWAY,)
        if self.is_seen:
            return str(oracle.outcome), tuple(oracle.states())
        return UNSEEN, ()

    def status(self, name: str, oracle: Oracle | PolicyOracle) -> MachineStatus:
        """Its machine's row, with all that it ever did."""
        inputs, outputs, _ = self.earlier
        verdict = str(oracle.outcome) if self.is_seen else UNSEEN
        states = tuple(oracle.states())
        if self.gone_ns is not None:
            verdict, states = str(self.reported or UNSEEN), (AWAY,)
        if self.violations and oracle.outcome is Outcome.CONFORMING:
            verdict = str(Outcome.VIOLATED)
        return MachineStatus(
            name,
            verdict,
            states,
            inputs + oracle.inputs,
            outputs + oracle.outputs,
            self.violations,
            self.late(oracle),
            statistics.median(self.lags) / 1e6 if self.lags else None,
            self.last,
        )
