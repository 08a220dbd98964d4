"""Observations made by hand, for the tests beside this file."""

from __future__ import annotations

from typing import Any

from transports.interface import Observation, ObservationKind

SENT, RECEIVED = ObservationKind.REQUEST_SENT, ObservationKind.REQUEST_RECEIVED
ANSWERED, RETURNED = ObservationKind.RESPONSE_SENT, ObservationKind.RESPONSE_RECEIVED


def seen(
    kind: ObservationKind,
    micros: int,
    call: int = 1,
    *,
    client: str = "client",
    channel: str = "/s",
    error: str = "",
    data: Any = None,
    received_micros: int | None = None,
) -> Observation:
    """One end of a call between `client` and `server`, ``micros`` µs after the epoch."""
    return Observation(
        stamp_ns=micros * 1000,
        received_ns=(micros if received_micros is None else received_micros) * 1000,
        channel=channel,
        kind=kind,
        type_name="p/srv/S",
        data={} if data is None else data,
        source="server" if kind in (RECEIVED, ANSWERED) else client,
        client=client,
        call=call,
        error=error,
    )


def message(
    channel: str, data: Any, micros: int = 0, received_micros: int | None = None
) -> Observation:
    """A message published by `node`."""
    return Observation(
        stamp_ns=micros * 1000,
        received_ns=(micros if received_micros is None else received_micros) * 1000,
        channel=channel,
        kind=ObservationKind.MESSAGE,
        type_name="p/msg/M",
        data=data,
        source="node",
    )
