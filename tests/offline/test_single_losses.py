"""One observation lost, whichever: no healthy node is accused; ``tests.offline.single_losses`` tries them all."""

from __future__ import annotations

import pytest

from tests.offline.single_losses import FORMS, accusations, kinds

pytestmark = pytest.mark.slow

SEEDS = (0, 1, 5)
EVERY = 9


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("seed", SEEDS)
def test_no_single_loss_accuses_a_healthy_node(seed: int, form: str) -> None:
    assert not list(accusations(seed, form, EVERY))


def test_the_systems_have_inputs_of_every_kind() -> None:
    assert kinds(0) >= {
        "/number message",
        "/plain_events/told message",
        "/work/_action/feedback message",
        "/work/_action/status message",
        "/work/_action/get_result response_received",
        "/work/_action/send_goal response_received",
        "/worker/ask response_received",
        "/probe/ask request_received",
        "/number message_taken",
    }
