"""Mutants that are equivalent for reasons no normal form finds, each with the argument.

They count only if the mutant never did anything else than the original in any scene.
"""

from __future__ import annotations

BY_HAND: dict[str, str] = {
    "BatteryComponent.ascxml:14: `10` became `11` in a condition": (
        "while it drains, the charge is even (100, or 10 after charging, and always 2 less)"
    ),
}
"""Argument by description."""
