"""One machine at random: what it has is added part by part, then its states are drawn.

What can happen to it are triggers, what it can send are outputs. Every channel, raised event and delayed
event has a depth: what a trigger of depth d starts leaves by outputs of depths over d alone. So no chain of
causes comes back to where it began, and a system rests once its timers have been answered.
"""

from __future__ import annotations

from collections.abc import Callable
from random import Random

import msgspec

from tests.campaign.elements import Element, e
from tests.campaign.kinds import BOOL, FLOAT64, INT32, STRING, Kind, Kinds, array
from tests.campaign.plans import NAMESPACE
from tests.campaign.values import Readable, Values, failing, parts_of
from tests.campaign.weights import CHAINS, STATEMENTS, happens, pick

Make = Callable[[Values], list[Element]]
"""Statements, where such values can be read."""

TRAPS = ("function='random'", "Math.random()", "error.execution", "unresponsive: ")
"""Texts of logs that mean something elsewhere."""


class Trigger(msgspec.Struct, frozen=True):
    """What a state may handle: the element, its attributes, what can be read in it."""

    tag: str
    attributes: tuple[tuple[str, str], ...]
    depth: int
    readable: Readable = ()
    always: bool = False
    """Whether every state handles it, without a condition."""
    missing: str = "handler missing"
    """How probable it is that a state does not handle it, if it need not."""


class Output(msgspec.Struct, frozen=True):
    """What the machine may send."""

    depth: int
    make: Make


class Machine:
    """A machine that is being made.

    Args:
        draw: where all chance comes from.
        kinds: the system's types.
        name: of the machine.
        draws: whether it draws random values.
    """

    def __init__(self, draw: Random, kinds: Kinds, name: str, draws: bool = False) -> None:
        self.draw = draw
        self.kinds = kinds
        self.name = name
        self.draws = draws
        self.fails = happens(draw, "may fail")
        self.data: list[Element] = []
        self.declarations: list[Element] = []
        self.threads: list[Element] = []
        self.triggers: list[Trigger] = []
        self.duties: dict[int, list[Make]] = {}
        self.outputs: list[Output] = []
        self.final_after_s = 0
        self._readable: list[tuple[str, Kind]] = []
        self._records = draw.choice(kinds.structures)
        self._names = [f"s{number}" for number in range(draw.randint(1, 3))]
        self._ids: list[str] = []
        self._variables()

    # -- data -------------------------------------------------------------------------------------

    def _variables(self) -> None:
        draw = self.draw
        for name, kind, value in (
            ("a", INT32, str(draw.randint(0, 3))),
            ("b", INT32, str(draw.randint(-2, 3))),
            ("on", BOOL, draw.choice(("true", "false"))),
            ("x", FLOAT64, "0.5"),
            ("word", STRING, "'on'"),
            ("numbers", array(INT32), "[1, 2]"),
            ("records", array(self._records), "[]"),
            ("record", self._records, None),
            ("LIMIT", INT32, str(draw.randint(2, 5))),
        ):
            self.variable(name, kind, value)

    def variable(self, name: str, kind: Kind, value: str | None) -> None:
        """Declare it; it can be read, and all but constants are assigned."""
        bounds = kind.is_integer and happens(self.draw, "bounds") and value is not None
        within = {"lower_bound_incl": -100, "upper_bound_incl": 100} if bounds else {}
        if value is not None and happens(self.draw, "declared by child elements"):
            data = e("data", Element("expr", text=value), id=name, type=kind.name, **within)
        else:
            data = e("data", id=name, type=kind.name, expr=value, **within)
        self.data.append(data)
        self._readable.append((name, kind))

    def hidden(self, name: str, kind: Kind, value: str) -> None:
        """Declare a variable that only the statements of one part read and assign."""
        self.data.append(e("data", id=name, type=kind.name, expr=value))

    def values(self, *readable: Readable) -> Values:
        """What may be written where ``readable`` can be read beside the machine's variables."""
        mine = [part for name, kind in self._readable for part in parts_of(name, kind)]
        found = Values(self.draw, tuple(mine), self.draws)
        for more in readable:
            found = found.also(more)
        return found

    # -- what it has ------------------------------------------------------------------------------

    def declare(self, tag: str, channel: str, kind: str, attribute: str) -> str:
        """Declare an interface; by what name it is referred to."""
        name = channel.strip("/").replace("/", "_").lower()
        if happens(self.draw, "short attribute"):
            attribute = attribute.removesuffix("_name")
        if happens(self.draw, "named by channel"):
            self.declarations.append(e(tag, **{attribute: channel, "type": kind}))
            return channel
        if happens(self.draw, "declared by child elements"):
            inner = (Element(attribute, text=channel), Element("type", text=kind))
            self.declarations.append(e(tag, *inner, name=name))
        else:
            self.declarations.append(e(tag, **{"name": name, attribute: channel, "type": kind}))
        return name

    def on(
        self, tag: str, depth: int, readable: Readable = (), always: bool = False, **head: str
    ) -> int:
        """Add a trigger; its number."""
        self.triggers.append(Trigger(tag, tuple(head.items()), depth, readable, always))
        return len(self.triggers) - 1

    def must(self, trigger: int, make: Make) -> None:
        """In every state that handles ``trigger`` this is done."""
        self.duties.setdefault(trigger, []).append(make)

    def may(self, depth: int, make: Make) -> None:
        """Add an output: some trigger of a lower depth has it for a duty, others for a choice."""
        self.outputs.append(Output(depth, make))
        able = [number for number, item in enumerate(self.triggers) if item.depth < depth]
        if able:
            self.must(self.draw.choice(able[-4:]), make)

    def timer(self, name: str, rate_hz: float) -> int:
        """Add a timer, which all states handle."""
        self.declarations.append(e("ros_time_rate", name=name, rate_hz=f"{rate_hz:g}"))
        return self.on("ros_rate_callback", 0, always=True, name=name)

    def pulse(self, name: str, rate_hz: float) -> None:
        """Add a timer, which some states handle."""
        self.declarations.append(e("ros_time_rate", name=name, rate_hz=f"{rate_hz:g}"))
        head = (("name", name),)
        self.triggers.append(Trigger("ros_rate_callback", head, 0, missing="pulse missing"))

    def note(self, depth: int) -> None:
        """An event that it raises, or sends itself."""
        name = f"note.n{depth}"
        readable: Readable = ()
        if self.draw.random() < 0.5:
            made = [e("raise", event=name)]
        else:
            param = e("param", name="number", expr="a")
            sent = e("send", param, event=name, target="#_internal")
            if self.draw.random() < 0.5:
                sent = e("send", event=name, target="#_internal", namelist="a")
                readable = (("_event.data.a", INT32),)
            else:
                readable = (("_event.data.number", INT32),)
            made = [sent]
        self.may(depth, lambda _: made)
        descriptor = "note.*" if happens(self.draw, "wildcard") else name
        self.on("transition", depth, readable if descriptor == name else (), event=descriptor)

    def later(self, depth: int) -> None:
        """An event that it sends itself with a delay, and may cancel."""
        name, ident = f"later.n{depth}", f"id{depth}"
        delay = self.draw.choice((20, 150, 400))
        if self.draw.random() < 0.5:
            made = e("send", event=name, delay=f"{delay}ms", id=ident)
        else:
            made = e("send", event=name, delayexpr=f"{delay}", id=ident)
        self._ids.append(ident)
        self.may(depth, lambda _: [made])
        self.on("transition", depth, event=name)

    def chain(self, start: int, depth: int) -> None:
        """Events that raise each other, often as many as are allowed, or more."""
        most = pick(self.draw, CHAINS)
        self.hidden("count", INT32, "0")
        again = e("raise", event="again")
        zero = e("assign", location="count", expr="0")
        self.must(start, lambda _: [zero, again])
        step = e("assign", location="count", expr="count + 1")
        if most < 1000:
            cond = f"count < {most}"
            self.chained = (e("transition", step, again, event="again", cond=cond),)
            self.on("transition", depth, event="again")
        else:
            self.chained = (e("transition", step, again, event="again"),)

    chained: tuple[Element, ...] = ()

    # -- content ----------------------------------------------------------------------------------

    def content(self, values: Values, depth: int, most: int = 2, inside: int = 0) -> list[Element]:
        """Some statements that send nothing of ``depth`` or less."""
        return [
            item
            for _ in range(self.draw.randint(0, most))
            for item in self.statement(values, depth, inside)
        ]

    def statement(self, values: Values, depth: int, inside: int = 0) -> list[Element]:
        """One statement, or none."""
        draw = self.draw
        match pick(draw, STATEMENTS):
            case "assign":
                name, kind = draw.choice(self._readable[:-1])
                return [e("assign", location=name, expr=values.of(kind))]
            case "element":
                place = draw.choice(("0", "1", "numbers.length - 1"))
                return [e("assign", location=f"numbers[{place}]", expr=values.integer())]
            case "member":
                name, kind = draw.choice(self._records.fields)
                return [e("assign", location=f"record.{name}", expr=values.of(kind))]
            case "append":
                return [self._append(values)]
            case "resize":
                return [e("assign", location="numbers.length", expr=str(draw.randint(1, 3)))]
            case "if" if not inside:
                return [self._if(values, depth)]
            case "log":
                label = draw.choice(("", "seen", *TRAPS))
                value = draw.choice((None, values.integer(), values.text(), f'"{TRAPS[0]}"'))
                return [e("log", label=label or None, expr=value or (None if label else "a"))]
            case "fail" if self.fails:
                return self._failure(values)
            case "emit" if able := [item for item in self.outputs if item.depth > depth]:
                return draw.choice(able).make(values)
            case "cancel" if self._ids:
                return [e("cancel", sendid=draw.choice(self._ids))]
            case _:
                return []

    def _append(self, values: Values) -> Element:
        if self.draw.random() < 0.5:
            grow = e("assign", location="numbers[numbers.length]", expr=values.integer())
            cut = e("assign", location="numbers", expr="[1, 2]")
            return e("if", grow, e("else"), cut, cond="numbers.length < 5")
        grow = e("assign", location="records[records.length]", expr="record")
        cut = e("assign", location="records", expr="[]")
        return e("if", grow, e("else"), cut, cond="records.length < 3")

    def _if(self, values: Values, depth: int) -> Element:
        parts = self.content(values, depth, 2, 1)
        if self.draw.random() < 0.4:
            parts += [e("elseif", cond=values.condition()), *self.content(values, depth, 1, 1)]
        if self.draw.random() < 0.5:
            parts += [e("else"), *self.content(values, depth, 1, 1)]
        return e("if", *parts, cond=self._condition(values))

    def _failure(self, values: Values) -> list[Element]:
        """A statement that fails, at its place in a block: what follows is not done."""
        value = failing(self.draw)
        match self.draw.randint(0, 3):
            case 0:
                return [e("log", label="fails", expr=f"'' + {value}")]
            case 1:
                inner = e("assign", location="b", expr=values.integer())
                return [e("if", inner, cond=f"{value} == 1")]
            case 2:
                return [e("assign", location="b", expr="numbers[7]")]
            case _:
                return [e("assign", location="record", expr="records[2]")]

    def _condition(self, values: Values) -> str:
        if self.fails and happens(self.draw, "condition fails"):
            return f"{failing(self.draw)} < {self.draw.randint(0, 3)}"
        return values.condition()

    # -- states -----------------------------------------------------------------------------------

    def root(self) -> Element:
        """The whole."""
        states = [self._state(index) for index in range(len(self._names))]
        if self.final_after_s:
            last = e("transition", after=f"{self.final_after_s}s", target="ended")
            states[-1] = states[-1].holding(*states[-1].children, last)
            states.append(e("final", id="ended"))
        parts = [e("datamodel", *self.data), *self.declarations, *self.threads, *states]
        given = {"xmlns": NAMESPACE, "version": "1.0", "datamodel": "ecmascript"}
        return e("scxml", *parts, **given, name=self.name, initial=self._names[0])

    @property
    def deepest(self) -> int:
        """Of its triggers: what a state does on entry and exit may follow each of them."""
        return max((item.depth for item in self.triggers), default=0)

    def _state(self, index: int) -> Element:
        draw = self.draw
        parts = []
        for tag in ("onentry", "onexit"):
            if happens(draw, f"content on {tag[2:]}"):
                parts.append(e(tag, *self.content(self.values(), self.deepest)))
        for number, trigger in enumerate(self.triggers):
            if trigger.always or not index or not happens(draw, trigger.missing):
                parts += self._handlers(number, trigger)
        parts += self.chained
        if self.fails and happens(draw, "handles errors"):
            seen = e("assign", location="b", expr="(b + 1) % 7")
            body = self.content(self.values(), self.deepest)
            parts.append(e("transition", seen, *body, event="error.execution"))
        later = self._names[index + 1 :]
        if later and happens(draw, "eventless transition"):
            body = self.content(self.values(), self.deepest)
            parts.append(
                e("transition", *body, cond=self.values().condition(), target=draw.choice(later))
            )
        if happens(draw, "delayed transition"):
            after = f"{draw.choice((300, 700, 1500))}ms"
            parts.append(
                self._leading(e("transition", *self.content(self.values(), 0), after=after))
            )
        return e("state", *parts, id=self._names[index])

    def _handlers(self, number: int, trigger: Trigger) -> list[Element]:
        draw = self.draw
        values = self.values(trigger.readable)
        head = dict(trigger.attributes)
        found = []
        if trigger.tag == "ros_action_handle_goal_response":
            accept, reject = draw.choice(self._names), draw.choice(self._names)
            body = self._body(number, trigger, values)
            return [e(trigger.tag, *body, **head, accept=accept, reject=reject)]
        if not trigger.always and happens(draw, "handler with condition"):
            given = f"{head.pop('cond')} && " if "cond" in head else ""
            cond = {"cond": given + self._condition(values)}
            body = self._body(number, trigger, values)
            found.append(self._maybe_leading(e(trigger.tag, *body, **head, **cond)))
            head = dict(trigger.attributes)
            if happens(draw, "only with condition"):
                return found
        body = self._body(number, trigger, values)
        return [*found, self._maybe_leading(e(trigger.tag, *body, **head))]

    def _body(self, number: int, trigger: Trigger, values: Values) -> list[Element]:
        duties = [item for make in self.duties.get(number, ()) for item in make(values)]
        content = self.content(values, trigger.depth)
        first = trigger.always or self.draw.random() < 0.85
        return [*duties, *content] if first else [*content, *duties]

    def _maybe_leading(self, handler: Element) -> Element:
        return self._leading(handler) if happens(self.draw, "handler leads to a state") else handler

    def _leading(self, handler: Element) -> Element:
        draw = self.draw
        if self.draws and len(self._names) > 1 and happens(draw, "targets by probability"):
            one, other = draw.sample(self._names, 2)
            targets = (e("target", id=one, prob="0.5"), e("target", id=other, prob="0.5"))
            return handler.holding(*targets, *handler.children)
        target = ("target", draw.choice(self._names))
        return msgspec.structs.replace(handler, attributes=(*handler.attributes, target))


def message(values: Values, kind: Kind) -> list[Element]:
    """``<field>`` elements that make a message; now and then one is left out."""
    draw = values.draw
    fields = []
    for name, inner in kind.fields:
        if name != kind.fields[0][0] and draw.random() < 0.1:
            continue
        if inner.is_record and draw.random() < 0.4:
            fields += [e("field", name=f"{name}.{n}", expr=values.of(k)) for n, k in inner.fields]
        else:
            fields.append(e("field", name=name, expr=values.of(inner)))
    return fields
