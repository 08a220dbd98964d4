"""Mutants that are equivalent for reasons no normal form finds, each with the argument.

They count only if the mutant never did anything else than the original in any scene.
"""

from __future__ import annotations

_ANSWERED = "the goal has had its answer by then; a second one is not sent"
_ENDED = "the goal has ended by then; it cannot end again"
_FREE = "nothing comes between the two, and what the second assigns is assigned already"

BY_HAND: dict[str, str] = {
    "BatteryComponent.ascxml:14: `10` became `11` in a condition": (
        "while it drains the charge is even: 100, and always 2 less"
    ),
    "BatteryComponent.ascxml:24: `100` became `99` in a condition": (
        "while it is charged the charge is 10, 25, 40, 55, 70, 85 or 100, and so never 99"
    ),
    "BatteryLevelSkill.scxml:15: transition of `idle` on message /BatteryComponent/level leads to "
    "`answer` instead of staying": (
        "every tick is answered before the next input, so none waits for what `answer` would send "
        "then, and it leads back to `idle` at once"
    ),
    "NavigationComponent.scxml:67: reject_goal drive sent twice": _ANSWERED,
    "NavigationComponent.scxml:71: accept_goal drive sent twice": _ANSWERED,
    "NavigationComponent.scxml:72: start_thread drive sent twice": (
        "the thread is `moving` after the first, where a start is discarded"
    ),
    "NavigationComponent.scxml:41: succeed drive sent twice": _ENDED,
    "NavigationComponent.scxml:47: cancel drive sent twice": _ENDED,
    "NavigationComponent.scxml:44: thread_free drive sent twice": _FREE,
    "NavigationComponent.scxml:50: thread_free drive sent twice": _FREE,
    "GoToPoiSkill.scxml:89: send_cancel go_to_poi sent twice": (
        "the goal has not been accepted there: that it is to be canceled is noted, once or twice, "
        "and asked for once when it is"
    ),
}
"""Argument by description."""

HOLES: dict[str, str] = {
    "server /": (
        "the node serves under a wrong name only and so never hears anything: it does nothing, and an "
        "oracle that has not seen its node take any request holds the node for not instrumented"
    ),
}
"""Why mutants that did something else survived, by what their description has in it."""
