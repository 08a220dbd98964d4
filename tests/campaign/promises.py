"""Properties of a system: some true of it by construction, most decided by what happens."""

from __future__ import annotations

from random import Random

from moon.properties.patterns import PatternName
from tests.campaign.channels import Channel
from tests.campaign.kinds import Kind
from tests.campaign.plans import Stated

PATTERNS = tuple(str(name) for name in PatternName)
SCOPES = ("", "before", "after", "between", "after_until")
"""As a property file writes them; \"\": globally."""


class Promises:
    """Draws ports and properties.

    Args:
        draw: where all chance comes from.
        channels: of the system.

    Attributes:
        ports: name to port.
        stated: the properties.
    """

    def __init__(self, draw: Random, channels: list[Channel]) -> None:
        self._draw = draw
        self.ports: dict[str, dict[str, object]] = {}
        self.stated: list[Stated] = []
        self._events: list[str] = []
        self._states: list[str] = []
        self._true: list[dict[str, object]] = []
        for number, channel in enumerate(channels):
            self._listen(f"c{number}", channel)

    def _listen(self, name: str, channel: Channel) -> None:
        match channel.kind:
            case "topic":
                assert channel.message is not None
                self._event(name, {"topic": channel.name})
                self._parts(name, {"topic": channel.name}, channel.message)
            case "event":
                topic = f"/plain_events/{channel.name.replace('.', '/')}"
                self._event(name, {"topic": topic})
                self._state(f"{name}_number", {"topic": topic, "field": "number"}, "{} > 1")
            case "service":
                assert channel.service is not None
                place = {"service": channel.name}
                request, response = (
                    self._event(f"{name}_{on}", {**place, "on": on})
                    for on in ("request", "response")
                )
                self._parts(f"{name}_answer", {**place, "on": "response"}, channel.service.response)
                self._true.append({"pattern": "precedence", "cause": request, "effect": response})
            case _:
                assert channel.action is not None
                place = {"action": channel.name}
                goal, feedback, result, _ = (
                    self._event(f"{name}_{on}", {**place, "on": on})
                    for on in ("goal", "feedback", "result", "cancel")
                )
                self._parts(f"{name}_got", {**place, "on": "result"}, channel.action.result)
                for effect in (feedback, result):
                    self._true.append({"pattern": "precedence", "cause": goal, "effect": effect})

    def _event(self, name: str, place: dict[str, object]) -> str:
        self.ports[name] = place
        self._events.append(name)
        return name

    def _state(self, name: str, port: dict[str, object], condition: str) -> None:
        self.ports[name] = port
        self._states.append(condition.format(name))

    def _parts(self, name: str, place: dict[str, object], kind: Kind) -> None:
        for field, inner in kind.fields:
            port = {**place, "field": field}
            if inner.is_integer:
                number = self._draw.randint(0, 3)
                if self._draw.random() < 0.3:
                    port["initial"] = 0
                self._state(
                    f"{name}_{field}", port, f"{{}} {self._draw.choice(('>', '<=', '=='))} {number}"
                )
                self._event(f"{name}_{field}_big", {**place, "when": f"data.{field} > {number}"})
                low = -(2**15) if inner.name in ("int8", "uint8") else None
                if low is not None:
                    self._impossible(
                        f"{name}_{field}_out", {**place, "when": f"data.{field} < {low}"}
                    )
            elif inner.name == "bool":
                self._state(f"{name}_{field}", port, "{}")

    def _impossible(self, name: str, place: dict[str, object]) -> None:
        self.ports[name] = place
        self._true.append({"pattern": "absence", "of": name})

    # -- properties -------------------------------------------------------------------------------

    def draw_some(self, count: int) -> None:
        """State ``count`` properties, a third of them true by construction."""
        draw = self._draw
        for number in range(count):
            body: dict[str, object]
            if self._true and number % 3 == 0:
                body, holds = draw.choice(self._true), True
            elif number % 7 == 6:
                body, holds = {"formula": self._formula()}, None
            else:
                body, holds = self._pattern(), None
            if draw.random() < 0.1:
                body = {**body, "role": "assumption"}
            self.stated.append(Stated(f"p{number}", body, holds))
        used = "\n".join(str(item.body) for item in self.stated)
        self.ports = {name: port for name, port in self.ports.items() if name in used}

    def _pattern(self) -> dict[str, object]:
        draw = self._draw
        pattern = draw.choice(PATTERNS)
        body: dict[str, object] = {"pattern": pattern}
        match pattern:
            case "precedence":
                body |= {"cause": self._condition(), "effect": self._condition()}
            case "response":
                body |= {"request": self._rare(), "response": self._condition()}
            case "response_chain":
                body |= {"request": self._rare(), "responses": [self._rare(), self._rare()]}
            case "precedence_chain":
                body |= {"causes": [self._rare(), self._rare()], "effect": self._rare()}
            case "bounded_existence":
                body |= {"of": self._rare(), "at_most": draw.randint(1, 20)}
            case _:
                body["of"] = self._condition()
        within = f"{draw.choice((0.3, 1, 2.5, 5))} s"
        needs = pattern in ("recurrence", "response", "response_chain")
        if needs or draw.random() < 0.4:
            body["within"] = within
        scope = draw.choice(SCOPES)
        if scope in ("between", "after_until"):
            body[scope] = [self._rare(), self._rare()]
        elif scope:
            body[scope] = self._rare()
        return body

    def _condition(self) -> object:
        if self._states and self._draw.random() < 0.3:
            return self._draw.choice(self._states)
        return self._rare()

    def _rare(self) -> object:
        """What holds for instants only."""
        draw = self._draw
        if self._states and draw.random() < 0.35:
            return {draw.choice(("rises", "falls")): draw.choice(self._states)}
        event = draw.choice(self._events)
        if self._states and draw.random() < 0.2:
            return f"{event} && {draw.choice(self._states)}"
        return event

    def _formula(self) -> str:
        draw = self._draw
        one, other = (draw.choice((*self._events, *self._states)) for _ in "12")
        past = draw.choice(("once", "historically", "once[:1]", "once[0.2:2]", "historically[:1]"))
        if draw.random() < 0.3:
            return f"historically(({{{one}}} since[0.1:3] {{{other}}}) -> once[:5]{{{one}}})"
        return f"historically({{{one}}} -> {past}{{{other}}})"
