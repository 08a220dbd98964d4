"""Mutants that are equivalent for reasons no normal form finds, each with the argument.

They count only if the mutant never did anything else than the original in any scene.
"""

from __future__ import annotations

_ANSWERED = "the goal has had its answer by then; a second one is not sent"
_ENDED = "the goal has ended by then; it cannot end again"
_CHARGING = "the thread is `charging` after the first, where a start is discarded"
_UNREAD = "the name of the vehicle is read before; a bay does nothing with it"
_ON_THE_GRID = "the temperature is 20 + 3.5 k: 58.5 and 62, 79.5 and 83, and nothing between"
_AND_BACK = "`tripping` has neither entry nor timer, and leads on by the number of trips, which has not changed"
_FREE = "nothing comes between the two, and what the second assigns is assigned already"
_EMPTY = "an empty belt has no first parcel: its number cannot be read, and such a condition does not hold"
_APART = "neither reads what the other changes, and where one fails, so does the other"
_ALWAYS_LATE = (
    "it publishes its battery as it does while it waits; an output may be a second late, so the oracle "
    "allows each of these to be begun before `after` has its turn"
)

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
    "ChargingStation.scxml:94: reject_goal charge sent twice": _ANSWERED,
    "ChargingStation.scxml:98: accept_goal charge sent twice": _ANSWERED,
    "ChargingStation.scxml:107: accept_goal charge sent twice": _ANSWERED,
    "ChargingStation.scxml:99: start_thread charge sent twice": _CHARGING,
    "ChargingStation.scxml:108: start_thread charge sent twice": _CHARGING,
    "ChargingStation.scxml:46: succeed charge sent twice": _ENDED,
    "ChargingStation.scxml:53: abort charge sent twice": _ENDED,
    "ChargingStation.scxml:60: cancel charge sent twice": _ENDED,
    "ChargingStation.scxml:100: start_thread charge: field `vehicle` left out": _UNREAD,
    "ChargingStation.scxml:109: start_thread charge: field `vehicle` left out": _UNREAD,
    "ChargingStation.scxml:47: succeed charge: field `level`: `level` became `target`": (
        "a goal is accepted with a level below its target, and charged until they are equal"
    ),
    **{
        f"{place} sent twice": why
        for place, why in (
            ("Planner.ascxml:29: reject_goal plan", _ANSWERED),
            ("Planner.ascxml:32: accept_goal plan", _ANSWERED),
            ("Planner.ascxml:35: abort plan", _ENDED),
            ("Planner.ascxml:46: succeed plan", _ENDED),
            ("Controller.ascxml:27: reject_goal follow", _ANSWERED),
            ("Controller.ascxml:33: accept_goal follow", _ANSWERED),
            ("Controller.ascxml:43: cancel follow", _ENDED),
            ("Controller.ascxml:48: abort follow", _ENDED),
            ("Controller.ascxml:53: succeed follow", _ENDED),
            ("Behaviors.ascxml:15: reject_goal spin", _ANSWERED),
            ("Behaviors.ascxml:21: accept_goal spin", _ANSWERED),
            ("Behaviors.ascxml:27: cancel spin", _ENDED),
            ("Behaviors.ascxml:32: succeed spin", _ENDED),
        )
    },
    "Planner.ascxml:36: abort plan: field `path.poses` left out": (
        "there are no poses then, and a field that is left out has none"
    ),
    "Planner.ascxml:43: the assignments to `poses[…].pose.position.x` and "
    "`poses[…].pose.position.y` swapped": _APART,
    "Courier.scxml:42: the assignment to `goal` dropped": (
        "a goal without a number is the last one sent, and a courier sends one at a time"
    ),
    **{
        f"PowerSupply.scxml:{line}: transition of `{state}` on {event} leads to `tripping` instead of "
        "staying": _AND_BACK
        for line, state, event in (
            (55, "tripped", "message load"),
            (58, "tripped", "timer measure"),
            (71, "tripped", "request /PowerSupply/Reset"),
            (77, "tripped", "request /PowerSupply/Repair"),
            (85, "broken", "message load"),
            (88, "broken", "timer measure"),
            (95, "broken", "request /PowerSupply/Reset"),
        )
    },
    "PowerSupply.scxml:26: `<` became `<=`": _ON_THE_GRID,
    "PowerSupply.scxml:26: `HOT` became `81` in a condition": _ON_THE_GRID,
    "PowerSupply.scxml:65: `<` became `<=`": _ON_THE_GRID,
    "PowerSupply.scxml:65: `COOL` became `61` in a condition": _ON_THE_GRID,
    "PowerSupply.scxml:65: `COOL` became `59` in a condition": _ON_THE_GRID,
    "GoToPoiSkill.scxml:90: send_cancel go_to_poi sent twice": (
        "the goal has not been accepted there: that it is to be canceled is noted, once or twice, "
        "and asked for once when it is"
    ),
    "Belt.ascxml:20: `>` became `>=`": _EMPTY,
    "Belt.ascxml:20: `0` became `-1` in a condition": _EMPTY,
    **{
        f"Bins.ascxml:{line}: the assignments to `bins[_event.data.bin].count` and "
        "`bins[_event.data.bin].weight` swapped": _APART
        for line in (21, 42)
    },
}
"""Argument by description."""

HOLES: dict[str, str] = {
    "server /": (
        "the node serves under a wrong name only and so never hears anything: it does nothing, and an "
        "oracle that has not seen its node take any request holds the node for not instrumented"
    ),
    "Forklift.scxml:54: transition of `charging` on aborted charge leads to `charging`": _ALWAYS_LATE,
    "Tugger.scxml:15: transition of `working` on after working#0 dropped": _ALWAYS_LATE,
    "Tugger.scxml:18: transition of `working` on timer report leads to `charging`": _ALWAYS_LATE,
}
"""Why mutants that did something else survived, by what their description has in it."""
