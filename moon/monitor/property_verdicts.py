"""What is published of a property's verdict: the reason, and what was observed that explains it."""

from __future__ import annotations

from m2c.model.walk import variables_of
from moon.monitor.departures import PREFIX
from moon.properties.describe import duration
from moon.properties.formula import predicates
from moon.properties.property import Fact, Property, Role, Status, Witness
from moon.properties.property import Verdict as PropertyVerdict
from moon.verdict import Evidence, Explanation, Outcome, Verdict
from moon.wording import Wording, is_short, value_text
from transports.interface import Observation

SHOWN_FACTS = 8
"""So many facts explain a violation, the latest; more would hide the point."""

OUTCOMES = {
    Status.TRUE: Outcome.CONFORMING,
    Status.FALSE: Outcome.VIOLATED,
    Status.INCONCLUSIVE: Outcome.INCONCLUSIVE,
}


def verdict_on(item: Property, verdict: PropertyVerdict, wording: Wording | None = None) -> Verdict:
    """What is published of ``verdict``: the property stands in for machine and node."""
    outcome = OUTCOMES[verdict.status]
    stamp = max(verdict.since_ns, 0)
    if outcome is not Outcome.VIOLATED:
        return Verdict.of(item.name, outcome, stamp, verdict.reason)
    broken = "assumption broken" if item.role is Role.ASSUMPTION else str(item.severity)
    reason = f"{broken}: {item.text or item.meaning}"
    why = _explained(item, verdict.witness, wording or Wording())
    return Verdict.of(item.name, outcome, stamp, reason, why)


def _explained(item: Property, witness: Witness | None, wording: Wording) -> Explanation:
    facts = witness.facts if witness is not None else ()
    facts = tuple(fact for fact in facts if not fact.predicate.startswith(PREFIX))
    shown = facts[-SHOWN_FACTS:]
    evidence = [Evidence(_since(fact), _fact(item, fact, wording)) for fact in shown]
    evidence.sort(key=lambda item: item.stamp_ns)
    if witness is not None and (len(shown) < len(facts) or not witness.complete):
        first_ns = evidence[0].stamp_ns if evidence else witness.at_ns
        evidence.insert(0, Evidence(first_ns, "(and more before)"))
    held = [_what(fact) for fact in shown[-2:]]
    return Explanation(
        (item.meaning,), " and ".join(held), evidence=tuple(evidence), places=(str(item.position),)
    )


def _since(fact: Fact) -> int:
    """Since when it is so: what was observed may have come before it mattered."""
    seen = fact.observation
    return fact.start_ns if seen is None else min(seen.stamp_ns, fact.start_ns)


def _what(fact: Fact) -> str:
    """The predicate as it was, and for how long."""
    what = fact.predicate if fact.value else f"not ({fact.predicate})"
    lasted = fact.end_ns - _since(fact)
    if (lasted + 1) % 1000 == 0:
        lasted += 1  # until the instant before something else was so
    return f"{what} for {duration(lasted)}" if lasted > 0 else what


def _fact(item: Property, fact: Fact, wording: Wording) -> str:
    seen = fact.observation
    if seen is None:
        return _what(fact)
    whose = f" of {seen.source}" if seen.source else ""
    kind = str(seen.kind).replace("_", " ")
    data = value_text(seen.data, wording.kind(seen.type_name)) if seen.data is not None else ""
    if not is_short(data) and (read := _fields_read(item, fact, seen)):
        data = f"{read} in {data}"
    return f"{_what(fact)}: {kind} on {seen.channel}{whose} {data}".rstrip()


def _fields_read(item: Property, fact: Fact, seen: Observation) -> str:
    """The fields of a message that the predicate is about, with their values; "" for the whole of it."""
    predicate = predicates(item.formula).get(fact.predicate)
    names = () if predicate is None else variables_of(predicate.expression)
    found: list[str] = []
    for port in item.ports:
        if port.name in names and port.path and port.channel == seen.channel:
            value = seen.data
            for name in port.path:
                value = value.get(name) if isinstance(value, dict) else None
            found.append(f"{'.'.join(port.path)}: {value_text(value)}")
    return ", ".join(found)
