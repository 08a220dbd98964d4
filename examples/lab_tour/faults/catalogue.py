"""The six faults of the paper's experiments (section VI-A, table II), written for this lab tour."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path

import msgspec

HERE = Path(__file__).resolve().parent


class Kind(StrEnum):
    """Where a fault is: the paper put T1 to T4 into models, T5 and T6 into generated code."""

    MODEL = "model"
    CODE = "code"


class Detected(StrEnum):
    """When a monitor of models can tell at the earliest."""

    AT_THE_DEADLINE = "at the deadline"  # of an answer that does not come
    AT_FIRST_OCCURRENCE = "at first occurrence"  # of a wrong output


class TableII(msgspec.Struct, frozen=True):
    """A row of the paper's table II: what its monitors of models and of properties found."""

    model_monitor: str
    p1: str
    p2: str
    p3: str


class Expected(msgspec.Struct, frozen=True):
    """What the monitor of the node's model should find, and by what it becomes visible.

    Attributes:
        when: at the deadline, or with the first wrong output.
        trigger: the channel of the input that the faulty answer is due to.
        owed: the channel of the output that the model owes instead.
        condition: what must have happened before, in words; "" if the first trigger shows it.
    """

    when: Detected
    trigger: str
    owed: str
    condition: str = ""


class Fault(msgspec.Struct, frozen=True):
    """One fault.

    Attributes:
        id: the paper's test ID.
        type: the paper's type of fault.
        node: the node that it is in, as ``m2c run --replace`` names it.
        kind: whether ``path`` is a model, or a patch for the node's generated package.
        path: the faulty model or the patch.
        what: what is wrong, in one line.
        paper: what the paper's monitors found.
        expected: where this system should find it.
    """

    id: str
    type: str
    node: str
    kind: Kind
    path: Path
    what: str
    paper: TableII
    expected: Expected


_TIMEOUT = "detects after timeout"
_FIRST = "detects at first occurrence"
_BELOW_30 = "detects when battery_level < 30 %"
_NONE = "no detection"
_IRRELEVANT = "not relevant"

FAULTS = (
    Fault(
        id="T1",
        type="unresponsiveness",
        node="BatteryLevelSkill",
        kind=Kind.MODEL,
        path=HERE / "T1-BatteryLevelSkill.scxml",
        what="takes the tick and does not answer it",
        paper=TableII(_TIMEOUT, _NONE, _BELOW_30, _IRRELEVANT),
        expected=Expected(
            Detected.AT_THE_DEADLINE, "/BatteryLevelSkill/tick", "/BatteryLevelSkill/tick"
        ),
    ),
    Fault(
        id="T2",
        type="unresponsiveness",
        node="SetPoi1Skill",
        kind=Kind.MODEL,
        path=HERE / "T2-SetPoi1Skill.scxml",
        what="sets the point of interest and does not answer the tick",
        paper=TableII(_TIMEOUT, _IRRELEVANT, _IRRELEVANT, _NONE),
        expected=Expected(
            Detected.AT_THE_DEADLINE, "/SchedulerComponent/SetPoi", "/SetPoi1Skill/tick"
        ),
    ),
    Fault(
        id="T3",
        type="incorrect response",
        node="BatteryLevelSkill",
        kind=Kind.MODEL,
        path=HERE / "T3-BatteryLevelSkill.scxml",
        what="answers at random while the charge is high",
        paper=TableII(_FIRST, _FIRST, _NONE, _IRRELEVANT),
        expected=Expected(
            Detected.AT_FIRST_OCCURRENCE,
            "/BatteryLevelSkill/tick",
            "/BatteryLevelSkill/tick",
            "chance chose FAILURE",
        ),
    ),
    Fault(
        id="T4",
        type="incorrect response",
        node="AlarmSkill",
        kind=Kind.MODEL,
        path=HERE / "T4-AlarmSkill.scxml",
        what="answers at random and never has the user notified",
        paper=TableII(_FIRST, _NONE, _NONE, _IRRELEVANT),
        expected=Expected(
            Detected.AT_FIRST_OCCURRENCE,
            "/AlarmSkill/tick",
            "/NotifyUserComponent/StartAlarm",
            "the battery fell below 30 %, so that the alarm is ticked",
        ),
    ),
    Fault(
        id="T5",
        type="incorrect parameter",
        node="BatteryLevelSkill",
        kind=Kind.CODE,
        path=HERE / "T5-BatteryLevelSkill.patch",
        what="subscribes to a misspelt topic and never receives the battery's level",
        paper=TableII(_FIRST, _NONE, _BELOW_30, _IRRELEVANT),
        expected=Expected(
            Detected.AT_FIRST_OCCURRENCE,
            "/BatteryLevelSkill/tick",
            "/BatteryLevelSkill/tick",
            "the battery fell below 30 %",
        ),
    ),
    Fault(
        id="T6",
        type="incorrect parameter",
        node="IsPoiDone1Skill",
        kind=Kind.CODE,
        path=HERE / "T6-IsPoiDone1Skill.patch",
        what="calls another service than its model says",
        paper=TableII(_FIRST, _IRRELEVANT, _IRRELEVANT, _NONE),
        expected=Expected(
            Detected.AT_FIRST_OCCURRENCE, "/IsPoiDone1Skill/tick", "/BlackboardComponent/GetInt"
        ),
    ),
)
"""In the order of the paper's table II."""


def fault(identifier: str) -> Fault:
    """The fault called ``identifier``; KeyError if there is none."""
    for found in FAULTS:
        if found.id == identifier:
            return found
    raise KeyError(identifier)
