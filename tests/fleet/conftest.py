"""What the tests of fleets share."""

from tests.monitor.conftest import start, wrong

__all__ = ["start", "wrong"]
