"""The ``<parameters>`` of a system file: how long, how often, how large."""

from __future__ import annotations

from collections.abc import Iterable

import msgspec

from m2c.diagnostics import DiagnosticLog
from m2c.model.structure import check_attributes, number, require
from m2c.model.xml import Element
from m2c.suggestions import nearest

DEFAULT_TICK_RATE_HZ = 1.0
DEFAULT_ARRAY_SIZE = 100
_ATTRIBUTES = {
    "max_time": ("value", "unit"),
    "max_array_size": ("value",),
    "bt_tick_rate": ("value",),
    "bt_tick_if_not_running": ("value",),
}
_UNITS_S = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}


class Parameters(msgspec.Struct, frozen=True, kw_only=True):
    """What a system file says of its runs.

    Attributes:
        tick_rate_hz: how often the behaviour tree is ticked.
        tick_if_not_running: whether the tree is ticked again after it has ended. A file that gives
            ``max_time`` describes a run with an end, and there the tree's end is one unless
            ``bt_tick_if_not_running`` says otherwise; without it, a system runs until it is stopped.
        max_time_s: how long a run in virtual time lasts, in seconds; None if the file does not say it.
        max_array_size: elements of an array without a bound, for tools that need one.
    """

    tick_rate_hz: float = DEFAULT_TICK_RATE_HZ
    tick_if_not_running: bool = True
    max_time_s: float | None = None
    max_array_size: int = DEFAULT_ARRAY_SIZE


def read_parameters(elements: Iterable[Element], log: DiagnosticLog) -> Parameters:
    """The parameters that ``elements``, the children of ``<parameters>``, give.

    Rules reported: ``unknown-tag``, ``unknown-attribute``, ``missing-attribute``, ``bad-rate`` and
    ``bad-parameter``.
    """
    given: dict[str, Element] = {}
    for element in elements:
        allowed = _ATTRIBUTES.get(element.tag)
        if allowed is None:
            hint = nearest(element.tag, _ATTRIBUTES)
            log.error("unknown-tag", element.position, element.tag, "not a parameter", hint)
            continue
        check_attributes(element, allowed, log)
        if element.tag in given:
            hint = f"the first is at {given[element.tag].position}"
            log.error("bad-parameter", element.position, element.tag, "given twice", hint)
        elif require(element, "value", log):
            given[element.tag] = element
    time_s = _time_s(given.get("max_time"), log)
    again = _flag(given.get("bt_tick_if_not_running"), log)
    return Parameters(
        tick_rate_hz=_rate_hz(given.get("bt_tick_rate"), log),
        tick_if_not_running="max_time" not in given if again is None else again,
        max_time_s=time_s,
        max_array_size=_size(given.get("max_array_size"), log),
    )


def _rate_hz(element: Element | None, log: DiagnosticLog) -> float:
    if element is None:
        return DEFAULT_TICK_RATE_HZ
    rate = number(element.get("value"))
    if rate is None or rate <= 0:
        what = f"`{element.get('value')}` is not a rate"
        hint = "ticks a second, greater than 0"
        log.error("bad-rate", element.at("value"), element.tag, what, hint)
        return DEFAULT_TICK_RATE_HZ
    return rate


def _time_s(element: Element | None, log: DiagnosticLog) -> float | None:
    if element is None:
        return None
    unit = require(element, "unit", log)
    if unit and unit not in _UNITS_S:
        what, hint = f"`{unit}` is not a unit of time", f"one of {', '.join(_UNITS_S)}"
        log.error("bad-parameter", element.at("unit"), element.tag, what, hint)
    time = number(element.get("value"))
    if time is None or time <= 0:
        _report(element, "a time", 'write it like value="100" unit="s"', log)
        return None
    return time * _UNITS_S.get(unit, 1.0)


def _size(element: Element | None, log: DiagnosticLog) -> int:
    if element is None:
        return DEFAULT_ARRAY_SIZE
    size = number(element.get("value"))
    if size is None or size < 1 or not size.is_integer():
        _report(element, "a size", "a whole number from 1", log)
        return DEFAULT_ARRAY_SIZE
    return int(size)


def _flag(element: Element | None, log: DiagnosticLog) -> bool | None:
    if element is None:
        return None
    flag = {"true": True, "false": False}.get(element.get("value").lower())
    if flag is None:
        _report(element, "true or false", "", log)
    return flag


def _report(element: Element, wanted: str, hint: str, log: DiagnosticLog) -> None:
    what = f"`{element.get('value')}` is not {wanted}"
    log.error("bad-parameter", element.at("value"), element.tag, what, hint)
