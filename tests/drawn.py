"""How many examples hypothesis draws: the same ones in every run of the suite, more and fresh ones in the soak."""

from __future__ import annotations

from hypothesis import settings

SOAK = "soak"
"""The profile of ``make soak`` (``tests/conftest.py``)."""


def examples(suite: int, soak: int) -> int:
    """``suite``, or ``soak`` where the profile is that; for ``max_examples``."""
    return soak if settings.get_current_profile_name() == SOAK else suite
