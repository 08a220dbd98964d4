"""Specification patterns (Dwyer, Avrunin, Corbett 1999) with time bounds, as past-time formulas.

A *scope* cuts time into segments ``[begin, end)``; a pattern says what a segment must look like:

* globally: one segment, from the start, never ending;
* before r: from the start to the first r (to the end of time if r never comes);
* after q: from the first q, never ending;
* between q and r: each stretch from the first q (while r does not hold) to the next r, judged when
  that r comes;
* after q until r: the same stretches, judged at once, whether or not r ever comes.

Every formula is false from the first instant at which the part of the segment seen so far, or the
segment's end, breaks the pattern; a fault stays one. The definitions, quantifier by quantifier, are in
docs/property-semantics.md, and the tests hold these formulas to them.
"""

from __future__ import annotations

from enum import StrEnum

import msgspec

from moon.properties.formula import (
    EVER,
    TRUE,
    Constant,
    Formula,
    Historically,
    Implies,
    Interval,
    Once,
    Since,
    conjunction,
    disjunction,
    negation,
)

MAX_OCCURRENCES = 20
"""Of a bounded existence: each counted occurrence is one more level of the formula."""
MAX_CHAIN = 8


class PatternName(StrEnum):
    """The patterns."""

    ABSENCE = "absence"
    UNIVERSALITY = "universality"
    EXISTENCE = "existence"
    BOUNDED_EXISTENCE = "bounded_existence"
    RECURRENCE = "recurrence"
    PRECEDENCE = "precedence"
    RESPONSE = "response"
    RESPONSE_CHAIN = "response_chain"
    PRECEDENCE_CHAIN = "precedence_chain"


class ScopeName(StrEnum):
    """The scopes."""

    GLOBALLY = "globally"
    BEFORE = "before"
    AFTER = "after"
    BETWEEN = "between"
    AFTER_UNTIL = "after_until"


class Scope(msgspec.Struct, frozen=True):
    """A scope with its delimiters: ``begin`` is q, ``end`` is r."""

    name: ScopeName = ScopeName.GLOBALLY
    begin: Formula | None = None
    end: Formula | None = None


class Pattern(msgspec.Struct, frozen=True):
    """A pattern over some events, in a scope.

    Attributes:
        name: which.
        events: absence, universality, existence, bounded existence, recurrence: (p,);
            response: (request, response); response chain: (request, first response, second …);
            precedence: (cause, effect); precedence chain: (first cause, second …, effect).
        scope: where it applies.
        bound: time, in ticks: of absence, universality and (bounded) existence, since the segment's
            begin; of recurrence, between two occurrences; of response and precedence, between the
            two; of a response chain, from each link to the next; of a precedence chain, from the
            last cause to the effect.
        most: of a bounded existence, how often at most.
    """

    name: PatternName
    events: tuple[Formula, ...]
    scope: Scope = Scope()
    bound: Interval = EVER
    most: int = 2


class PatternError(ValueError):
    """A pattern with the wrong number of events, or a bound it cannot have."""


def pattern_formula(pattern: Pattern) -> Formula:
    """The formula of ``pattern``.

    Raises:
        PatternError: it is incomplete or has a bound that means nothing for it.
    """
    _check(pattern)
    return _Segment(pattern.scope).formula(pattern)


def looking_back(pattern: Pattern) -> Formula | None:
    """What MOON makes of ``time=``, for absence and universality: over the last ``time``.

    None if it makes nothing of its own of ``pattern``.
    """
    scope = pattern.scope
    if pattern.name not in (PatternName.ABSENCE, PatternName.UNIVERSALITY):
        return None
    if scope.name not in (ScopeName.GLOBALLY, ScopeName.AFTER) or len(pattern.events) != 1:
        return None
    event = pattern.events[0]
    asked = negation(event) if pattern.name is PatternName.ABSENCE else event
    if scope.begin is not None:
        asked = Implies(Once(scope.begin), asked)
    return Historically(asked, pattern.bound)


def deadline(pattern: Pattern) -> int | None:
    """Ticks after which something still missing counts as a fault; None if nothing ever does."""
    needs = (
        PatternName.EXISTENCE,
        PatternName.RESPONSE,
        PatternName.RESPONSE_CHAIN,
        PatternName.RECURRENCE,
    )
    if pattern.name not in needs or pattern.scope.name is ScopeName.BETWEEN:
        return None
    return pattern.bound.upper


_EVENTS = {
    PatternName.PRECEDENCE: (2, 2),
    PatternName.RESPONSE: (2, 2),
    PatternName.RESPONSE_CHAIN: (3, MAX_CHAIN),
    PatternName.PRECEDENCE_CHAIN: (3, MAX_CHAIN),
}


def _check(pattern: Pattern) -> None:
    least, most = _EVENTS.get(pattern.name, (1, 1))
    if not least <= len(pattern.events) <= most:
        wanted = str(least) if least == most else f"{least} to {most}"
        raise PatternError(f"{pattern.name} takes {wanted} events, not {len(pattern.events)}")
    scope = pattern.scope
    begins = scope.name in (ScopeName.AFTER, ScopeName.BETWEEN, ScopeName.AFTER_UNTIL)
    ends = scope.name in (ScopeName.BEFORE, ScopeName.BETWEEN, ScopeName.AFTER_UNTIL)
    if begins != (scope.begin is not None) or ends != (scope.end is not None):
        wanted = " and ".join(["a begin"] * begins + ["an end"] * ends) or "no delimiter"
        raise PatternError(f"the scope {scope.name} takes {wanted}")
    lower, upper = pattern.bound.lower, pattern.bound.upper
    if upper is not None and upper < lower:
        raise PatternError("the time bound ends before it begins")
    if pattern.name is PatternName.RECURRENCE and (upper is None or lower):
        raise PatternError("recurrence needs a time `within` which it recurs, and no `after`")
    if pattern.name is PatternName.RESPONSE_CHAIN and (lower or upper == 0):
        raise PatternError("a response chain takes a time `within` of more than 0, no `after`")
    if pattern.name is PatternName.BOUNDED_EXISTENCE and not 0 <= pattern.most <= MAX_OCCURRENCES:
        raise PatternError(f"at most 0 to {MAX_OCCURRENCES} occurrences can be counted")


def _before(formula: Formula) -> Formula:
    return formula if isinstance(formula, Constant) else just_before(formula)


def just_before(formula: Formula) -> Formula:
    """``formula`` one tick ago."""
    return Once(formula, Interval(1, 1))


class _Segment:
    """A scope's segments as formulas over the instant at hand."""

    def __init__(self, scope: Scope) -> None:
        self._name = scope.name
        begin, end = scope.begin or TRUE, scope.end
        match scope.name:
            case ScopeName.GLOBALLY:
                self.inside: Formula = TRUE
            case ScopeName.BEFORE:
                assert end is not None
                self.inside = negation(Once(end))
            case ScopeName.AFTER:
                self.inside = Once(begin)
            case ScopeName.BETWEEN | ScopeName.AFTER_UNTIL:
                assert end is not None
                self._open = negation(end)
                self._start = conjunction(begin, self._open)
                self.inside = Since(self._open, self._start)
        self._begin, self._end = begin, end

    # -- the words of the definitions ---------------------------------------------------------

    def begun(self, ticks: int) -> Formula:
        """Inside a segment that began at least ``ticks`` ago."""
        if ticks == 0:
            return self.inside
        ago = Interval(ticks)
        match self._name:
            case ScopeName.GLOBALLY:
                return Once(TRUE, ago)
            case ScopeName.BEFORE:
                return conjunction(self.inside, Once(TRUE, ago))
            case ScopeName.AFTER:
                return Once(self._begin, ago)
            case _:
                return Since(self._open, self._start, ago)

    def window(self, bound: Interval) -> Formula:
        """Inside a segment that began between ``bound`` ago."""
        if bound.upper is None:
            return self.begun(bound.lower)
        return conjunction(self.begun(bound.lower), negation(self.begun(bound.upper + 1)))

    def seen(self, formula: Formula, interval: Interval = EVER) -> Formula:
        """``formula`` held in this segment, ``interval`` ago."""
        happened = conjunction(self.inside, formula)
        if self._name in (ScopeName.BETWEEN, ScopeName.AFTER_UNTIL):
            return Since(self._open, happened, interval)
        if self._name is ScopeName.BEFORE:
            return Once(formula, interval)
        return Once(happened, interval)

    def pending(self, request: Formula, response: Formula, ticks: int = 0) -> Formula:
        """In this segment a request at least ``ticks`` ago, and no response from then on."""
        waits = conjunction(self.inside, negation(response))
        return Since(waits, conjunction(waits, request), Interval(ticks))

    def judge(self, at_once: Formula, at_end: Formula) -> Formula:
        """Never ``at_once`` in a segment, and not ``at_end`` just before it closed."""
        faults = []
        if self._name is ScopeName.BETWEEN:
            assert self._end is not None
            at_end = disjunction(self.seen(at_once), at_end)
            faults.append(conjunction(self._end, _before(at_end)))
        else:
            faults.append(at_once)
            if self._end is not None:
                faults.append(conjunction(self._end, _before(at_end)))
        return Historically(negation(disjunction(*faults)))

    # -- the patterns -------------------------------------------------------------------------

    def formula(self, pattern: Pattern) -> Formula:
        """The whole property."""
        first, bound = pattern.events[0], pattern.bound
        never = negation(TRUE)
        match pattern.name:
            case PatternName.ABSENCE:
                return self.judge(conjunction(self.window(bound), first), never)
            case PatternName.UNIVERSALITY:
                return self.judge(conjunction(self.window(bound), negation(first)), never)
            case PatternName.EXISTENCE:
                return self._existence(first, bound)
            case PatternName.BOUNDED_EXISTENCE:
                return self._bounded_existence(first, bound, pattern.most)
            case PatternName.RECURRENCE:
                assert bound.upper is not None
                silent = negation(Once(first, Interval(0, bound.upper)))
                return self.judge(conjunction(self.begun(bound.upper), silent), never)
            case PatternName.PRECEDENCE:
                effect = conjunction(self.inside, pattern.events[1])
                return self.judge(conjunction(effect, negation(self.seen(first, bound))), never)
            case PatternName.PRECEDENCE_CHAIN:
                return self._precedence_chain(pattern)
            case PatternName.RESPONSE:
                return self._response(first, pattern.events[1], bound)
            case PatternName.RESPONSE_CHAIN:
                return self._response_chain(pattern)

    def _existence(self, first: Formula, bound: Interval) -> Formula:
        missing = conjunction(
            self.inside, negation(self.seen(conjunction(self.window(bound), first)))
        )
        late = negation(TRUE)
        if bound.upper is not None:
            late = conjunction(self.begun(bound.upper), missing)
        return self.judge(late, missing)

    def _bounded_existence(self, first: Formula, bound: Interval, most: int) -> Formula:
        present = conjunction(self.window(bound), first)
        rise = conjunction(present, negation(just_before(present)))
        count = self.seen(rise)
        for _ in range(most):
            count = self.seen(conjunction(rise, just_before(count)))
        return self.judge(count, negation(TRUE))

    def _precedence_chain(self, pattern: Pattern) -> Formula:
        *causes, effect = pattern.events
        seen = self.seen(causes[0])
        for place, cause in enumerate(causes[1:], 2):
            last = place == len(causes)
            seen = self.seen(conjunction(cause, just_before(seen)), pattern.bound if last else EVER)
        return self.judge(conjunction(self.inside, effect, negation(seen)), negation(TRUE))

    def _response(self, request: Formula, response: Formula, bound: Interval) -> Formula:
        low, high = bound.lower, bound.upper
        late = negation(TRUE)
        if low == 0:
            if high is not None:
                late = self.pending(request, response, high)
            return self.judge(late, self.pending(request, response))
        asked = conjunction(self.inside, request)
        if high is not None:
            answered = Once(response, Interval(0, high - low))
            expired = Since(self.inside, asked, Interval(high, high))
            late = conjunction(expired, negation(answered))
        ripe = Since(self.inside, asked, Interval(low, low))
        young = Since(self.inside, asked, Interval(0, low - 1))
        return self.judge(late, disjunction(self.pending(ripe, response), young))

    def _response_chain(self, pattern: Pattern) -> Formula:
        request, *responses = pattern.events
        high = pattern.bound.upper
        late, open_ends = [], []
        for place, response in enumerate(responses):
            # a later link answers strictly after the one before it: it is asked for one tick later
            hop = high if high is None or place == 0 else high - 1
            if hop is not None:
                late.append(self.pending(request, response, max(hop, 0)))
            waiting = self.pending(request, response)
            open_ends.append(waiting)
            link = conjunction(self.inside, response, disjunction(request, just_before(waiting)))
            if place < len(responses) - 1:
                open_ends.append(link)
                request = just_before(link)
        return self.judge(disjunction(*late), disjunction(*open_ends))
