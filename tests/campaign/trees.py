"""Behaviour trees at random, over given leaves: every leaf is ticked somewhere."""

from __future__ import annotations

from random import Random

import msgspec

from tests.campaign.elements import Element, e
from tests.campaign.skills import Leaf
from tests.campaign.weights import (
    CONTROLS,
    DECORATORS,
    FILLERS,
    NAV2_CONTROLS,
    NAV2_DECORATORS,
    SCRIPTS,
    happens,
    pick,
)

DEPTH = 4
_COMPARED = (("Int", "2"), ("Double", "0.5"), ("String", "2"), ("Bool", "true"))
"""Kinds of ``BlackboardCheck``, and a value of each that may equal the number ``{level}``."""


class Tree:
    """Draws the policy.

    Args:
        draw: where all chance comes from.
        leaves: of skills and plugins.
        wraps: names of plugins with a child.
        nav2: whether it has control nodes of Nav2, too.
    """

    def __init__(
        self, draw: Random, leaves: list[Leaf], wraps: list[str], nav2: bool = False
    ) -> None:
        self._controls = {**CONTROLS, **(NAV2_CONTROLS if nav2 else {})}
        self._decorators = {**DECORATORS, **(NAV2_DECORATORS if nav2 else {})}
        self._draw = draw
        self._leaves = leaves
        self._wraps = wraps
        self._trees: list[Element] = []

    def root(self) -> Element:
        """The policy: a tree of at least as many nodes as there are leaves."""
        draw = self._draw
        leaves = [*self._leaves]
        draw.shuffle(leaves)
        parts = [self._above(leaf.element, 0) for leaf in leaves]
        start = e("Script", code="level := 2; other := 0")
        top = pick(draw, {"Sequence": 2, "ParallelAll": 4, "Fallback": 1})
        if top == "ParallelAll":
            main = e("ParallelAll", *parts, max_failures=len(parts))
        else:
            # one after the other, whatever it answers
            always = "ForceSuccess" if top == "Sequence" else "ForceFailure"
            main = e(top, *(e(always, part) for part in parts))
        tree = e("BehaviorTree", e("Sequence", start, main), ID="Main")
        return e("root", tree, *self._trees, BTCPP_format=4, main_tree_to_execute="Main")

    def _above(self, inner: Element, depth: int) -> Element:
        """``inner`` with something around it, or not."""
        draw = self._draw
        if depth >= DEPTH or draw.random() < 0.25:
            return inner
        if draw.random() < 0.55:
            around = self._decorated(inner, pick(draw, self._decorators))
        else:
            around = self._control(inner, pick(draw, self._controls))
        if happens(draw, "scripted node"):
            script = draw.choice(list(SCRIPTS.items()))
            around = msgspec.structs.replace(around, attributes=(*around.attributes, script))
        return self._above(around, depth + 1)

    def _decorated(self, inner: Element, tag: str) -> Element:
        draw = self._draw
        match tag:
            case "RetryUntilSuccessful":
                return e(tag, inner, num_attempts=draw.randint(2, 3))
            case "Repeat":
                return e(tag, inner, num_cycles=draw.randint(2, 3))
            case "Delay":
                return e(tag, inner, delay_msec=draw.choice((50, 300)))
            case "Timeout":
                return e(tag, inner, msec=draw.choice((250, 900)))
            case "RateController":
                return e(tag, inner, hz=draw.choice((1, 3)))
            case "RunOnce":
                return e(tag, inner, then_skip=draw.choice(("true", "false")))
            case "SubTree":
                name = f"Sub{len(self._trees)}"
                self._trees.append(e("BehaviorTree", inner, ID=name))
                return e("SubTree", ID=name, _autoremap="true")
            case "Precondition":
                otherwise = draw.choice(("FAILURE", "RUNNING", "SKIPPED"))
                return e(tag, inner, **{"if": "level < 5", "else": otherwise})
            case "SkipUnlessUpdated" | "WaitValueUpdate":
                return e(tag, inner, entry="{level}")
            case "BlackboardCheckInt":
                # without a draw of its own: what is drawn after it stays as it was
                one, other = _COMPARED[len(inner.children) % len(_COMPARED)]
                return e(f"BlackboardCheck{one}", inner, value_A="{level}", value_B=other)
            case "LoopInt" | "LoopDouble" | "LoopBool" | "LoopString":
                queue = {"LoopInt": "1;2", "LoopDouble": "0.5", "LoopBool": "true;false"}
                return e(tag, inner, queue=queue.get(tag, "a;b"), value=f"{{{tag}}}")
            case _ if tag.startswith("Switch"):
                count = int(tag[-1])
                others = [self._filler() for _ in range(count)]
                cases = {f"case_{number}": number + 1 for number in range(1, count + 1)}
                # to a Switch an entry is text: no plugin writes this one
                return e(tag, inner, *others, variable="{mark}", **cases)
            case "plugin" if self._wraps:
                return e("Action", inner, ID=draw.choice(self._wraps))
            case "plugin":
                return e("Inverter", inner)
            case _:
                return e(tag, inner)

    def _control(self, inner: Element, tag: str) -> Element:
        """``inner`` is the one that is reached."""
        draw = self._draw
        other = self._filler()
        match tag:
            case "Parallel":
                if draw.random() < 0.5:
                    return e(tag, inner, other, success_count=draw.randint(1, 2))
                return e(tag, inner, other)
            case "ParallelAll":
                return e(tag, inner, other, max_failures=draw.randint(1, 2))
            case "RoundRobin":
                return e(tag, inner, other, wrap_around=draw.choice(("true", "false")))
            case "RecoveryNode":
                return e(tag, inner, other, number_of_retries=draw.randint(1, 2))
            case "TryCatch":
                return e(tag, inner, other, catch_on_halt=draw.choice(("true", "false")))
            case "PersistentSequence":
                start = e("Script", code="place := 0")
                return e("Sequence", start, e(tag, inner, other, current_child_idx="{place}"))
            case "IfThenElse" | "WhileDoElse":
                return e(tag, self._test(), inner, other)
            case "Fallback" | "ReactiveFallback" | "AsyncFallback":
                return (
                    e(tag, e("AlwaysFailure"), inner)
                    if draw.random() < 0.3
                    else e(tag, inner, other)
                )
            case _:
                return e(tag, self._test(), inner) if draw.random() < 0.5 else e(tag, inner, other)

    def _test(self) -> Element:
        draw = self._draw
        conditions = [leaf.element for leaf in self._leaves if not leaf.is_action]
        if conditions and draw.random() < 0.6:
            return draw.choice(conditions)
        return e("ScriptCondition", code=f"level >= {draw.randint(0, 2)}")

    def _filler(self) -> Element:
        draw = self._draw
        match pick(draw, FILLERS):
            case "Sleep":
                return e("Sleep", msec=draw.choice((30, 300)))
            case "Script":
                return e("Script", code="other := other + 1")
            case "SetBlackboard":
                return e("SetBlackboard", value=draw.randint(1, 9), output_key="mark")
            case "UnsetBlackboard":
                return e("UnsetBlackboard", key="mark")
            case "WasEntryUpdated":
                return e("WasEntryUpdated", entry="{level}")
            case "test":
                return self._test()
            case tag:
                return e(tag)
