"""Runs the lab tour as it is and with each of the paper's six faults, every model monitored.

``python examples/lab_tour/faults/run.py [--transport zenoh|ros2|simulated|all] [--json] [--fault T1 …]``
prints the paper's table II beside what was found here; with ``--properties`` all of it: the paper's
properties P1 to P3 and three more are monitored, too, each run lasting a whole tour. With ``--transport
all``, everything is run on each, and the verdicts must be the same.

Exit code 0: every fault was found in the node that has it, as soon as it can be, and by the properties
that it breaks; neither the tour as it is nor any other node was blamed; 1: not so; 2: it could not be run.
"""

from __future__ import annotations

import argparse
import logging
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import by_property
import msgspec
from busy import busy
from catalogue import FAULTS, Fault, fault
from inject import SYSTEM, PatchError
from judging import Row, differences, judged, judged_nominal, with_properties
from listener import Run
from processes import RunError, find_interfaces, on_ros2, on_zenoh
from simulated_run import simulated
from table import brief, found, latency, show

if TYPE_CHECKING:
    from m2c.model.system import System
    from moon.properties.property import Property

TOUR_S = 30.0
"""One tour and the start of the next one."""

Runner = Callable[["Fault | None", "System", float, "Sequence[Property]", bool], Run]
"""Runs the tour with a fault (None: as it is) for so many seconds after the first tick, or until the
fault is found; beside the models monitors properties (then all of the time); keeps what it heard or not."""

RUNNERS: dict[str, Runner] = {"simulated": simulated, "zenoh": on_zenoh, "ros2": on_ros2}


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description="Run the paper's faults, every model monitored.")
    parser.add_argument(
        "--transport",
        choices=(*RUNNERS, "all"),
        default="zenoh",
        help="where (default: zenoh); all: on each, and the verdicts are compared",
    )
    parser.add_argument("--json", action="store_true", help="one JSON object a line")
    parser.add_argument("--brief", action="store_true", help="a line for each fault, no table")
    parser.add_argument(
        "--fault",
        action="append",
        choices=[item.id for item in FAULTS],
        help="only this one, and the tour as it is (repeatable)",
    )
    parser.add_argument(
        "--properties", action="store_true", help="monitor the tour's properties, too"
    )
    parser.add_argument(
        "--nominal", type=float, metavar="SECONDS", help="only the tour as it is, this long"
    )
    parser.add_argument(
        "--busy", type=int, default=0, metavar="N", help="beside N processes that only compute"
    )
    parser.add_argument(
        "--record",
        type=Path,
        metavar="FOLDER",
        help="write what is received to FOLDER/<fault>-<transport>.jsonl, an observation a line",
    )
    chosen = parser.parse_args(arguments)
    logging.basicConfig(level=logging.CRITICAL)  # what the policy complains of is the fault at work
    from m2c.model import ModelError
    from moon.monitor.reading import read_checked
    from moon.properties.files import load_properties
    from transports.interface import TransportError

    transports = list(RUNNERS) if chosen.transport == "all" else [chosen.transport]
    rows: list[Row] = []
    try:
        if "ros2" in transports:
            find_interfaces()
        system = read_checked([SYSTEM])
        properties = load_properties(by_property.PROPERTIES) if chosen.properties else []
        names = list(dict.fromkeys(chosen.fault or [item.id for item in FAULTS]))
        with busy(chosen.busy):
            for transport in transports:
                seconds = chosen.nominal or TOUR_S
                rows.append(_row(transport, None, system, seconds, properties, chosen.record))
                _report(rows[-1], chosen.json)
                for name in [] if chosen.nominal else names:
                    row = _row(transport, fault(name), system, TOUR_S, properties, chosen.record)
                    rows.append(row)
                    _report(rows[-1], chosen.json)
    except (PatchError, ModelError, RunError, TransportError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    differ = differences(rows)
    if chosen.brief:
        print("\n".join(brief(rows)))
    elif not chosen.json:
        show(rows)
        if len(transports) > 1:
            print("\n".join(differ) or f"The verdicts are the same on {', '.join(transports)}.")
    return 0 if all(row.is_well for row in rows) and not differ else 1


def _row(
    transport: str,
    chosen: Fault | None,
    system: System,
    seconds: float,
    properties: Sequence[Property],
    record: Path | None,
) -> Row:
    keeps = chosen is not None or record is not None
    run = RUNNERS[transport](chosen, system, seconds, properties, keeps)
    if record is not None:
        record.mkdir(parents=True, exist_ok=True)
        name = "nominal" if chosen is None else chosen.id
        lines = msgspec.json.Encoder().encode_lines(run.heard)
        (record / f"{name}-{transport}.jsonl").write_bytes(lines)
    row = judged_nominal(run) if chosen is None else judged(chosen, run)
    return msgspec.structs.replace(with_properties(row, chosen, run), transport=transport)


def _report(row: Row, as_json: bool) -> None:
    if as_json:
        print(msgspec.json.encode(row).decode(), flush=True)
    else:
        text = f"{row.id} on {row.transport}: {found(row)} {latency(row)}"
        print(text.rstrip(), file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main())
