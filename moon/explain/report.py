"""What is observed of a machine, in words."""

from __future__ import annotations

import os
from collections.abc import Sequence

from moon.explain.observables import Input, Observables, Output, Timer, Unchecked
from moon.explain.policy import PolicyObservables

ASSUMED = (
    "A monitor subscribes to every channel, so anything that a node sends where its model has no output is "
    "found too. "
    "It receives calls as both ends' service events: nodes made by m2c publish them; of a node that "
    "publishes none, requests and responses cannot be checked."
)


def report(found: Observables) -> list[str]:
    """The lines on one machine."""
    lines = [f"{found.machine}  {near(found.file)}"]
    lines += _block("inputs", _columns([_input(item) for item in found.inputs]))
    lines += _block("outputs", _columns([_output(item) for item in found.outputs]))
    lines += _block("timers", _columns([_timer(item) for item in found.timers]))
    hidden = f"not checked, or only by what comes after ({found.transitions} transitions in all)"
    return lines + _block(hidden, _columns([_unchecked(item) for item in found.unchecked]))


def policy_report(found: PolicyObservables) -> list[str]:
    """The lines on the policy."""
    head = found.policy if found.policy == "policy" else f"policy {found.policy}"
    lines = [f"{head}  {near(found.file)}"]
    lines += _block("judged by", [found.judged_by])
    return lines + _block("not checked", _columns([_unchecked(item) for item in found.unchecked]))


def near(place: str) -> str:
    """A file or ``file:line:column`` as seen from the working directory, where that is shorter."""
    relative = os.path.relpath(place)
    return relative if len(relative) < len(place) else place


def line_of(place: str) -> str:
    """``line:column`` of a place whose file is known."""
    return ":".join(place.rsplit(":", 2)[1:])


def _block(title: str, rows: Sequence[str]) -> list[str]:
    return [f"  {title}", *(f"    {row}" for row in rows or ["none"])]


def _columns(rows: Sequence[tuple[str, ...]]) -> list[str]:
    if not rows:
        return []
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    return [
        "  ".join(text.ljust(width) for text, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    ]


def _input(item: Input) -> tuple[str, ...]:
    note = "" if item.taken else "; no transition takes it"
    return (item.what, item.channel, item.type_name, f"stamped by {item.stamped_by}{note}")


def _output(item: Output) -> tuple[str, ...]:
    if not item.places:
        return (item.what, item.channel, item.type_name, "never: any is a violation")
    places = ", ".join(line_of(place) for place in item.places)
    return (item.what, item.channel, item.type_name, f"within {item.deadline_s:g} s  from {places}")


def _timer(item: Timer) -> tuple[str, ...]:
    due = "after a computed delay" if item.period_s is None else f"after {item.period_s:g} s"
    if item.what == "rate" and item.period_s is not None:
        due = f"every {item.period_s:g} s"
    return (item.what, item.name, f"{due}, up to {item.tolerance_s:g} s late", line_of(item.place))


def _unchecked(item: Unchecked) -> tuple[str, ...]:
    return (line_of(item.place), item.what, item.why)
