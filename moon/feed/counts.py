"""What was received, and what of it cannot be judged."""

from __future__ import annotations

from collections import Counter

import msgspec


class Counts(msgspec.Struct):
    """What a monitor received, and what it could not use.

    Attributes:
        received: observations; ``heard`` in JSON.
        unconcerned: observations that concern no monitored machine.
        future: observations whose stamp lies in the future.
        unnamed: messages that do not say who sent them; their stamps are taken with caution.
        mistyped: messages that are not of the type that the models say: nodes drop those too.
        repeated: observations received twice.
        late: observations that came too late to be judged.
        before: observations of before the monitor listened (or listened again).
        stalls: how often the monitor was held up, or the clock was set.
        unknown: how many observations there were on channels that no model names.
    """

    received: int = msgspec.field(default=0, name="heard")
    unconcerned: int = 0
    future: int = 0
    unnamed: int = 0
    mistyped: int = 0
    repeated: int = 0
    late: int = 0
    before: int = 0
    stalls: int = 0
    unknown: Counter[str] = msgspec.field(default_factory=Counter)
