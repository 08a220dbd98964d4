"""Static checks over machines and systems.

The names below are loaded when they are first used: whoever imports :mod:`m2c` imports this package.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from m2c.check.flow import check_flow
    from m2c.check.system import check_system
    from m2c.check.types import check_types

__all__ = ["check_flow", "check_system", "check_types"]

_HOMES = {"check_flow": "flow", "check_system": "system", "check_types": "types"}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)
