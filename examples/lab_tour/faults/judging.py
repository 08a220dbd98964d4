"""Whether a fault was found where and when it should be."""

from __future__ import annotations

from collections.abc import Sequence

import by_property
import msgspec
from by_property import Cell
from catalogue import Detected, Fault
from listener import DEADLINE_NS, LATENCY_NS, Run, Said
from onset import Onset, onset

from transports.interface import ObservationKind

LATE_NS = 200_000_000
"""A missing output should be reported this long after its deadline, at the latest: one latency bound, and
what is left for the monitor's timer and a busy machine."""
CERTAIN_NS = 5_000_000_000 + LATE_NS + LATENCY_NS
"""A fault is certain when nothing can be missing that explains it: at the latest when the tree has waited 5 s
for the answer in vain."""
MOST_LOST = 3
"""A monitor that was held up finds machines again when they next do something; ResetSkill, say, is ticked
once in a tour."""


class Row(msgspec.Struct, frozen=True):
    """One line of the result.

    Attributes:
        id: of the fault; ``nominal`` for the tour as it is.
        transport: that it was run on.
        type, paper: as the paper has them.
        node: that has the fault.
        violated: the machines that were found in violation, in the order of the verdicts.
        detected: whether the faulty one was found, as soon as it should be.
        latency_ms: from the first wrong output, or the input that was not answered, to when it was said:
            as *violated*, or as *inconclusive* while it was not certain that no observation is missing.
        after_deadline_ms: for missing outputs: from the deadline to then; None if the machine took another
            input before the deadline, and so will not send them any more.
        certain_ms: from the first wrong output or that input to the verdict *violated*.
        first: whether the verdict is about the first wrong output.
        reason: the first line of the explanation.
        problem: why it counts as failed; "" if all is well.
        properties: what each property found, if they were monitored.
    """

    id: str
    transport: str = ""
    type: str = ""
    node: str = ""
    paper: str = ""
    violated: tuple[str, ...] = ()
    detected: bool = False
    latency_ms: float | None = None
    after_deadline_ms: float | None = None
    certain_ms: float | None = None
    first: bool | None = None
    reason: str = ""
    problem: str = ""
    properties: tuple[Cell, ...] = ()

    @property
    def is_well(self) -> bool:
        """Whether the models' monitors and the properties found what they should."""
        return self.detected and not any(cell.problem for cell in self.properties)


def judged(chosen: Fault, run: Run) -> Row:
    """Whether ``chosen`` was found where and when it should be."""
    blamed = tuple(dict.fromkeys(said.verdict.node for said in run.violations))
    row = Row(
        id=chosen.id,
        type=chosen.type,
        node=chosen.node,
        paper=chosen.paper.model_monitor,
        violated=blamed,
    )
    said = next((item for item in run.violations if item.verdict.node == chosen.node), None)
    ignored = None if said is None else _ignored(chosen.node, said, run)
    wrong: Onset | None = ignored or onset(chosen.id, run.heard, LATENCY_NS)
    if wrong is None:
        return _failed(row, "the fault never showed itself: nothing could be found")
    if said is None:
        return _failed(row, f"missed: {wrong.what} {_seconds(run, wrong.stamp_ns)}, and no verdict")
    certain_ns = said.at_ns - wrong.stamp_ns
    named = [item.at_ns for item in run.unconfirmed if item.verdict.node == chosen.node]
    at_ns = min((at for at in named if at >= wrong.stamp_ns), default=said.at_ns)
    latency_ns = min(at_ns, said.at_ns) - wrong.stamp_ns
    row = msgspec.structs.replace(
        row, reason=_reason(said), latency_ms=latency_ns / 1e6, certain_ms=certain_ns / 1e6
    )
    if certain_ns > CERTAIN_NS:
        return _failed(row, f"certain only after {certain_ns / 1e9:.1f} s")
    if ignored is not None or chosen.expected.when is Detected.AT_THE_DEADLINE:
        late_ns = latency_ns - DEADLINE_NS
        row = msgspec.structs.replace(row, after_deadline_ms=late_ns / 1e6)
        if late_ns < 0 and not said.verdict.is_silence:
            # it took another input without having answered: it will not answer any more
            row = msgspec.structs.replace(row, after_deadline_ms=None)
        elif late_ns < 0:
            return _failed(row, "said before the deadline was over")
        if late_ns > LATE_NS:
            return _failed(row, f"said {late_ns / 1e6:.0f} ms after the deadline")
    else:
        after_ms = (said.verdict.stamp_ns - wrong.stamp_ns) / 1e6
        row = msgspec.structs.replace(row, first=not after_ms)
        if after_ms > 0:
            return _failed(row, f"not the first wrong output, but one {after_ms:.0f} ms later")
        if after_ms < 0:
            return _failed(row, f"blamed {-after_ms:.0f} ms before the first wrong output")
    others = [item for item in run.violations if item.verdict.node != chosen.node]
    if others:
        return _failed(row, f"blamed without a fault: {_told(others)}")
    return msgspec.structs.replace(row, detected=True)


def _ignored(node: str, said: Said, run: Run) -> Onset | None:
    """The message that ``said`` is about, if it is that ``node`` never took one, and it did not."""
    if not said.verdict.reason.endswith("the message was not taken"):
        return None
    taken = {
        (item.channel, item.client, item.call)
        for item in run.heard
        if item.kind is ObservationKind.MESSAGE_TAKEN and item.source == node
    }
    for item in run.heard:
        is_it = item.stamp_ns == said.verdict.stamp_ns and item.kind is ObservationKind.MESSAGE
        if is_it and (item.channel, item.source, item.sequence) not in taken:
            return Onset(item.stamp_ns, f"message {item.sequence} was not taken")
    return None


def judged_nominal(run: Run) -> Row:
    """Whether nothing was found in the tour as it is."""
    blamed = tuple(dict.fromkeys(said.verdict.node for said in run.violations))
    row = Row(id="nominal", type="no fault", violated=blamed, detected=not blamed)
    if not run.count:
        return _failed(row, "nothing was received")
    if run.violations:
        return _failed(row, f"a false alarm: {_told(run.violations)}")
    if len(run.lost) > MOST_LOST:
        return _failed(row, f"not known what these do: {', '.join(run.lost)}")
    return row


def with_properties(row: Row, chosen: Fault | None, run: Run) -> Row:
    """``row`` with what the properties found."""
    if not run.standing:
        return row
    wrong = None if chosen is None else onset(chosen.id, run.heard, LATENCY_NS)
    since = wrong.stamp_ns if wrong is not None else None
    found = by_property.cells(chosen, run.broken, since, run.standing)
    return msgspec.structs.replace(row, properties=found)


def differences(rows: Sequence[Row]) -> list[str]:
    """Where the verdicts on one fault differ from transport to transport, one sentence each."""
    found = []
    first: dict[str, Row] = {}
    for row in rows:
        other = first.setdefault(row.id, row)
        for what, one, here in (
            ("in violation", other.violated, row.violated),
            ("found", other.detected, row.detected),
            ("broken", _broken(other), _broken(row)),
        ):
            if one != here:
                found.append(
                    f"{row.id}: {what}: {_named(one)} on {other.transport}, "
                    f"{_named(here)} on {row.transport}"
                )
    return found


def _broken(row: Row) -> tuple[str, ...]:
    return tuple(cell.property for cell in row.properties if cell.broken)


def _named(verdict: tuple[str, ...] | bool) -> str:
    if isinstance(verdict, bool):
        return "yes" if verdict else "no"
    return ", ".join(verdict) or "nobody"


def _told(violations: Sequence[Said]) -> str:
    """Who is blamed, and for what first."""
    first: dict[str, str] = {}
    for said in violations:
        first.setdefault(said.verdict.node, _reason(said))
    return ", ".join(f"{name} ({reason})" for name, reason in first.items())


def _reason(said: Said) -> str:
    return str(said.verdict.reason.splitlines()[0])


def _failed(row: Row, problem: str) -> Row:
    return msgspec.structs.replace(row, detected=False, problem=problem)


def _seconds(run: Run, stamp_ns: int) -> str:
    return f"after {(stamp_ns - run.heard[0].stamp_ns) / 1e9:.1f} s"
