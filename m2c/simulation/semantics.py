"""What models mean in a run in virtual time: as robots run them, or as AS2FM has it (docs/semantics.md)."""

from __future__ import annotations

from enum import StrEnum

import msgspec

from m2c.runtime.binding import DEFAULT_SETTINGS, NodeSettings
from transports.simulated import Conditions, SimulatedWorld


class Semantics(StrEnum):
    """``DEPLOYED``: SCXML, with queues between nodes. ``AS2FM``: steps in turn, messages without delay."""

    DEPLOYED = "deployed"
    AS2FM = "as2fm"

    @property
    def is_stepwise(self) -> bool:
        """Whether eventless transitions are steps in turn with those of other machines."""
        return self is Semantics.AS2FM

    def world(self, seed: int, conditions: Conditions | None = None) -> SimulatedWorld:
        """A world for such runs. AS2FM's messages take no time, whatever ``conditions`` say."""
        if self is Semantics.DEPLOYED:
            return SimulatedWorld(seed, conditions)
        at_once = msgspec.structs.replace(
            conditions or Conditions(), delay_s=(0.0, 0.0), tap_delay_s=(0.0, 0.0)
        )
        return SimulatedWorld(seed, at_once, ranked=True)

    def settings(self, seconds: float) -> NodeSettings:
        """How nodes behave towards the others in a run of ``seconds``."""
        if self is Semantics.DEPLOYED:
            return DEFAULT_SETTINGS
        return NodeSettings(call_timeout_s=self.tick_timeout_s(seconds), events_wait=True)

    def tick_timeout_s(self, seconds: float) -> float:
        """How long a leaf may take to answer in a run of ``seconds``: AS2FM knows no time limit."""
        return 5.0 if self is Semantics.DEPLOYED else seconds + 1.0
