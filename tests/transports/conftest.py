"""What the tests in this folder share."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.transports.zenoh_network import Network


@pytest.fixture
def network() -> Iterator[Network]:
    """Nodes on Zenoh, around an endpoint of their own."""
    opened = Network()
    yield opened
    opened.close()
