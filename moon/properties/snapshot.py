"""Where a group of monitors stands: what it takes to go back there, or to go on from there elsewhere."""

from __future__ import annotations

from typing import Any

import msgspec

from moon.properties.gaps import Gap
from moon.properties.property import Verdict
from moon.properties.three_valued import ThreeValued
from moon.properties.witness import Change


class Snapshot(msgspec.Struct, frozen=True):
    """A group of monitors at some instant. Snapshots with equal ``future`` go on alike."""

    networks: tuple[tuple[dict[str, Any], list[tuple[int, int]]], ...]
    three_valued: ThreeValued | None
    unknown: dict[str, str]
    scalars: tuple[int, int, int, int, int]
    lost: str
    lost_ports: dict[str, str]
    coming: tuple[Gap, ...]
    open: dict[str, tuple[int, str]]
    values: dict[str, Any]
    waiting: frozenset[str]
    verdicts: tuple[Verdict, ...]
    logs: dict[str, tuple[Change, ...]]

    forms: tuple[tuple[Any, ...], ...]
    """Per network, what decides how it goes on, without what no later instant can see."""

    @property
    def future(self) -> tuple[Any, ...]:
        """What decides how the group goes on."""
        statuses = tuple(verdict.status for verdict in self.verdicts)
        gaps = (self.lost_ports, self.coming, self.open)
        return self.forms, self.unknown, self.scalars[:3], self.values, self.waiting, gaps, statuses
