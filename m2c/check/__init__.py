"""Static checks over machines and systems."""

from m2c.check.flow import check_flow
from m2c.check.system import check_system
from m2c.check.types import check_types

__all__ = ["check_flow", "check_system", "check_types"]
