"""Strangers attack a live lab tour with monitor and recorder beside it: all live, and nobody is accused."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.attacks.lab import Lab
from tests.attacks.strangers import ATTACKS

pytestmark = [pytest.mark.zenoh, pytest.mark.slow]

SECONDS = 2.0
"""How long each attack goes on here; ``python -m tests.attacks.soak`` has hours."""
SEED = 21


class _Labs:
    """One lab for all tests, a new one when it has fallen."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._lab: Lab | None = None

    def standing(self) -> Lab:
        if self._lab is None or not self._lab.stands:
            self.close()
            self._lab = Lab(self._folder)
        return self._lab

    def close(self) -> None:
        if self._lab is not None:
            self._lab.close()


@pytest.fixture(scope="module")
def labs(tmp_path_factory: pytest.TempPathFactory) -> Iterator[_Labs]:
    made = _Labs(tmp_path_factory.mktemp("lab"))
    yield made
    made.close()


@pytest.mark.parametrize("name", ATTACKS)
def test_an_attack_fells_nobody_and_nobody_is_accused(labs: _Labs, name: str) -> None:
    labs.standing().attack([name], SEED, SECONDS)


def test_after_all_of_that_everything_ends_as_it_should(labs: _Labs) -> None:
    lab = labs.standing()
    lab.look("at the end")
    lab.end()


def test_a_tour_is_completed_under_attack_by_many_though_listeners_stop_and_die(
    tmp_path: Path,
) -> None:
    lab = Lab(tmp_path, ticks=150)
    try:
        lab.attack(["tokens", "payloads", "wrongly_typed", "twins", "calls"], SEED, SECONDS)
        lab.monitor.send(signal.SIGSTOP)
        lab.recorder.process.kill()
        lab.recorder.process.wait()
        before = lab.ticks
        lab.goes_on(before + 10)  # nobody waits for who stands still
        lab.monitor.send(signal.SIGCONT)
        assert lab.run.end() == 0, lab.run.said
        assert lab.ticks == 150
        assert lab.monitor.end(signal.SIGINT) == 0, lab.monitor.said
        assert lab.monitor.violated == set()
    finally:
        lab.close()
    assert threading.active_count() < 50
