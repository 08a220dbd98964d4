"""Random machines whose values are at the limits of their types, and runs of them.

``python -m tests.codegen.limits --models 5000 --seed 0`` is the long run: it prints every machine whose
node raises, sends what cannot be encoded, or is not what its own oracle says. Exit code 1 if there is one.
"""

from __future__ import annotations

import argparse
import functools
import logging
import sys
import tempfile
import traceback
from pathlib import Path
from random import Random
from typing import Any
from xml.sax.saxutils import quoteattr

import msgspec

from m2c.check import check_types
from m2c.language.datatypes import INTEGER_RANGES, Array, DataType, Primitive, Structure
from m2c.model import DiagnosticLog, System, load
from m2c.runtime.messages import message_class
from m2c.simulation.program import Program, compile_node
from m2c.simulation.run import SimulatedRun
from moon.oracle.bounds import Bounds
from moon.oracle.oracle import Oracle
from moon.recording.cdr import Decoder
from moon.recording.cdr_writing import HEADER, encoder
from moon.verdict import Verdict
from transports.interface import Observation, ObservationKind, Topic
from transports.simulated import SimulatedTransport, SimulatedWorld

INTERFACES = {
    "limits/msg/Inner.msg": "int32 n\nfloat32 f\nstring s\nbool[] flags\n",
    "limits/msg/Values.msg": "".join(
        [
            "bool b\nbyte o\nchar c\n",
            *(f"{sign}int{bits} {sign[:1] or 'i'}{bits}\n" for bits in (8, 16, 32, 64) for sign in ("", "u")),
            "float32 f32\nfloat64 f64\nstring s\nint32[] many\nuint8[<=3] few\nint16[3] three\n",
            "float32[2] pair\nstring[] words\nlimits/Inner inner\nlimits/Inner[] inners\nint32 faults\n",
        ]
    ),
}  # fmt: skip
INTEGERS = [*(f"{s}{n}" for n in (8, 16, 32, 64) for s in ("i", "u")), "o", "c"]
FLOATS = ["f32", "f64"]
ARRAYS = {"many": "int", "few": "int", "three": "int", "pair": "float", "words": "text"}
VARIABLES = [
    ("b", "bool"),
    ("o", "byte"),
    ("c", "char"),
    *(
        (f"{'u' if sign else 'i'}{n}", f"{sign}int{n}")
        for n in (8, 16, 32, 64)
        for sign in ("", "u")
    ),
    *(("f32", "float32"), ("f64", "float64"), ("s", "string"), ("many", "int32[]")),
    *(("few", "uint8[<=3]"), ("three", "int16[3]"), ("pair", "float32[2]"), ("words", "string[]")),
    *(("inner", "limits/Inner"), ("inners", "limits/Inner[]")),
]
WHOLE = [
    "0",
    "1",
    "-1",
    "2",
    "3",
    "7",
    "127",
    "128",
    "255",
    "256",
    "-128",
    "32767",
    "65535",
    "2147483647",
]
WHOLE += [
    "-2147483648",
    "4294967295",
    "9007199254740991",
    "9007199254740993",
    "9223372036854775807",
]
WHOLE += ["-9223372036854775808", "18446744073709551615"]
REAL = [
    "0.0",
    "-0",
    "0.1",
    "-0.5",
    "1.5",
    "2.5",
    "1e308",
    "-1e308",
    "5e-324",
    "3.4028235e38",
    "1e39",
]
REAL += ["Infinity", "-Infinity", "NaN", "0 / 0", "Math.PI", "16777217"]
TEXT = ["''", "'a'", "'é\\u{1F600}'", "'12'", "'-0'", "'1e400'", "'0x10'", "'line\\n'", "'\\\\'"]
RATE_HZ = 10.0
EVENTS_S = 0.033


class Writer:
    """Writes one machine; all chance comes from ``draw``."""

    def __init__(self, draw: Random) -> None:
        self._draw = draw

    def _one(self, items: list[str]) -> str:
        return self._draw.choice(items)

    # -- expressions ----------------------------------------------------------------------------

    def expression(self, kind: str, depth: int = 3) -> str:
        """An expression that is, or may be, of ``kind``: int, float, text, bool."""
        if self._draw.random() < 0.04:
            kind = self._one(["int", "float", "text", "bool"])
        if depth == 0 or self._draw.random() < 0.25:
            return self._atom(kind)
        if self._draw.random() < 0.1:
            test, deeper = self.expression("bool", depth - 1), depth - 1
            return f"({test} ? {self.expression(kind, deeper)} : {self.expression(kind, deeper)})"
        if self._draw.random() < 0.06:
            operator = self._one(["&&", "||"])
            left, right = self.expression(kind, depth - 1), self.expression(kind, depth - 1)
            return f"({left} {operator} {right})"
        return getattr(self, f"_{kind}")(depth - 1)

    def _atom(self, kind: str) -> str:
        message = self._one(["", "", "_msg."])
        match kind:
            case "int":
                if self._draw.random() < 0.35:
                    return self._one(WHOLE)
                lengths = ["many.length", "s.length", "three.length", "three[1]", "inner.n"]
                return message + self._one([*INTEGERS, *INTEGERS, *lengths])
            case "float":
                if self._draw.random() < 0.35:
                    return self._one(REAL)
                return self._one(["x", message + self._one([*FLOATS, "inner.f", "pair[0]"])])
            case "text":
                return self._one([*TEXT, f"{message}s", "inner.s", "s", "typeof s", "typeof x"])
            case _:
                return self._one(["true", "false", f"{message}b", "b"])

    def _int(self, depth: int) -> str:
        choice = self._draw.random()
        left, right = self.expression("int", depth), self.expression("int", depth)
        if choice < 0.6:
            return f"({left} {self._one(['+', '-', '*', '%'])} {right})"
        if choice < 0.7:
            name = self._one(["max", "min"])
            return f"Math.{name}({left}, {right})"
        if choice < 0.8:
            name = self._one(["abs", "sign", "floor", "round"])
            return f"Math.{name}({left})"
        if choice < 0.87:
            name = self._one(["floor", "ceil", "round", "trunc"])
            return f"Math.{name}({self.expression('float', depth)})"
        if choice < 0.94:
            name = self._one(["many", "few", "three"])
            return f"{name}[{left}]"
        return f"-({left})"

    def _float(self, depth: int) -> str:
        choice = self._draw.random()
        kinds = [self._one(["int", "float"]) for _ in "ab"]
        left, right = (self.expression(kind, depth) for kind in kinds)
        if choice < 0.5:
            return f"({left} {self._one(['+', '-', '*', '/', '%'])} {right})"
        if choice < 0.6:
            return f"((0 + {left}) ** {right})"  # -a ** b is a syntax error
        if choice < 0.8:
            name = self._one(["sqrt", "exp", "log", "sin", "cbrt", "abs", "log2", "tan", "acos"])
            return f"Math.{name}({left})"
        if choice < 0.9:
            name = self._one(["hypot", "atan2", "pow", "max", "min"])
            return f"Math.{name}({left}, {right})"
        return f"pair[{left}]"

    def _text(self, depth: int) -> str:
        other = self.expression(self._one(["int", "float", "text", "bool"]), depth)
        if self._draw.random() < 0.25:
            return self._one(["words", "s"]) + f"[{self.expression('int', depth)}]"
        return f"({self.expression('text', depth)} + {other})"

    def _bool(self, depth: int) -> str:
        if self._draw.random() < 0.15:
            return f"!{self.expression('bool', depth)}"
        kind = self._one(["int", "float", "text"])
        operator = self._one(["==", "!=", "<", "<=", ">", ">=", "===", "!=="])
        return f"({self.expression(kind, depth)} {operator} {self.expression(kind, depth)})"

    # -- statements -----------------------------------------------------------------------------

    def statement(self, depth: int = 2) -> str:
        choice = self._draw.random()
        if choice < 0.55:
            return self._assign()
        if choice < 0.72:
            return self._part()
        if choice < 0.8 and depth:
            test = quoteattr(self.expression("bool"))
            first, second = self.statement(depth - 1), self.statement(depth - 1)
            return f"<if cond={test}>{first}<else/>{second}</if>"
        if choice < 0.86:
            return (
                f"<log label='seen' expr={quoteattr(self.expression(self._one(['int', 'text'])))}/>"
            )
        if choice < 0.93:
            kind = self._one(["int", "float", "text", "bool"])
            given = quoteattr(self.expression(kind))
            return f'<send event="told" target="#_internal"><param name="p" expr={given}/></send>'
        return self.publish(self._draw.sample(VARIABLES, 4))

    def _assign(self) -> str:
        kind = self._one(["int", "int", "float", "text", "bool", "untyped"])
        names = {"int": INTEGERS, "float": [*FLOATS, "x"], "text": ["s"], "bool": ["b"]}
        if kind == "untyped":
            values = ["many", "words", "inner", "u", "[u, 1]", "_msg.words", "[]", "s", "i8"]
            return _assign("u", self._one(values))
        return _assign(self._one(names[kind]), self.expression(kind))

    def _part(self) -> str:
        index = self._one(
            ["0", "1", "2", "5", "many.length", "i8", "u8", self.expression("int", 1)]
        )
        name = self._one(list(ARRAYS))
        match self._draw.randrange(7):
            case 0:
                return _assign(f"{name}.length", self._one(["0", "1", "2", "3", "7", "u8", "i8"]))
            case 1:
                values = [f"_msg.{name}", name, "[]", *(["many", "few"] if name != "words" else [])]
                return _assign(name, self._one(values))
            case 2:
                field = self._one(["n", "f", "s"])
                kind = {"n": "int", "f": "float", "s": "text"}[field]
                holder = self._one(["inner", "inner", f"inners[{index}]"])
                return _assign(f"{holder}.{field}", self.expression(kind))
            case 3:
                literal = f"{{n: {self.expression('int')}, f: {self.expression('float')}}}"
                values = ["_msg.inner", literal, f"inners[{index}]", "inner"]
                return _assign(self._one(["inner", f"inners[{index}]"]), self._one(values))
            case 4:
                count = {"few": 3, "three": 3, "pair": 2}.get(name, self._draw.randint(0, 3))
                kind = ARRAYS[name]
                items = ", ".join(self.expression(kind) for _ in range(count))
                return _assign(name, f"[{items}]")
            case 5:
                return _assign(
                    "inners", self._one(["_msg.inners", "[inner]", "[]", "[_msg.inner]"])
                )
            case _:
                return _assign(f"{name}[{index}]", self.expression(ARRAYS[name]))

    def publish(self, names: list[tuple[str, str]]) -> str:
        fields = []
        for name, written in names:
            value = name
            if self._draw.random() < 0.3 and "[" not in written and "/" not in written:
                kind = {"s": "text", "b": "bool", "f32": "float", "f64": "float"}.get(name, "int")
                value = self.expression(kind)
            fields.append(f"<field name={quoteattr(name)} expr={quoteattr(value)}/>")
        return f'<ros_topic_publish name="/out">{"".join(fields)}</ros_topic_publish>'

    def machine(self) -> str:
        """A machine that does something with each message, and tells all that it holds ten times a second."""
        data = "".join(f'<data id="{name}" type={quoteattr(kind)}/>' for name, kind in VARIABLES)
        whole = "".join(f'<field name="{name}" expr="{name}"/>' for name, _ in VARIABLES)
        body = "".join(self.statement() for _ in range(self._draw.randint(1, 5)))
        told = _assign(self._one(["i32", "f64", "s", "b", "u"]), "_event.data.p")
        return f"""<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" datamodel="ecmascript" name="Limits">
<ros_topic_subscriber topic="/in" type="limits/Values"/>
<ros_topic_publisher topic="/out" type="limits/Values"/>
<ros_time_rate name="clock" rate_hz="{RATE_HZ}"/>
<datamodel>{data}<data id="x" expr="1"/><data id="u" expr="[]"/><data id="faults" type="int32"/></datamodel>
<state id="a">
<ros_topic_callback name="/in">{body}</ros_topic_callback>
<ros_rate_callback name="clock"><ros_topic_publish name="/out">{whole}
<field name="faults" expr="faults"/></ros_topic_publish></ros_rate_callback>
<transition event="told">{told}</transition>
<transition event="error.execution"><assign location="faults" expr="faults + 1"/></transition>
</state></scxml>"""


def _assign(location: str, value: str) -> str:
    return f"<assign location={quoteattr(location)} expr={quoteattr(value)}/>"


# -- values for messages ----------------------------------------------------------------------------


def value_of(kind: DataType, draw: Random) -> Any:
    """A value at the limits of ``kind``, as a message holds it."""
    match kind:
        case Primitive(name) if name in INTEGER_RANGES:
            low, high = INTEGER_RANGES[name]
            return draw.choice([low, high, 0, 1, max(low, -1), high - 1])
        case Primitive("bool"):
            return draw.random() < 0.5
        case Primitive("string"):
            return draw.choice(["", "a", "12", "\U0001f600", "é" * 9])
        case Primitive("float32"):
            return draw.choice([0.0, -0.0, 0.5, 2.0**127, float("inf"), float("nan"), -1.0])
        case Primitive():
            return draw.choice([0.0, -0.0, 0.1, 1e308, -1e308, float("inf"), float("nan"), 5e-324])
        case Structure():
            values = {name: value_of(inner, draw) for name, inner in kind.fields}
            return message_class(kind)(**values)
        case Array(element, length, fixed):
            count = length if fixed else draw.randint(0, min(3, length or 3))
            return [value_of(element, draw) for _ in range(count or 0)]


# -- runs -------------------------------------------------------------------------------------------


class Result(msgspec.Struct, frozen=True):
    """What became of one machine.

    Attributes:
        text: the model.
        accepted: whether ``m2c check`` had nothing against it.
        problems: what went wrong in the run.
        published: messages that it sent.
        faults: errors of execution that it counted.
        last: what it published last.
    """

    text: str
    accepted: bool
    problems: tuple[str, ...] = ()
    published: int = 0
    faults: int = 0
    last: dict[str, Any] = {}


@functools.cache
def _folder() -> Path:
    folder = Path(tempfile.mkdtemp(prefix="limits"))
    for name, content in INTERFACES.items():
        path = folder / "interfaces" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(content)
    return folder


def read(text: str) -> System | None:
    """The system of one machine; None if the check has something against it."""
    path = _folder() / "limits.scxml"
    path.write_text(text)
    log = DiagnosticLog()
    system = load([path], log)
    if system is None or log.has_errors:
        return None
    check_types(system.nodes[0], system.library, log)
    return None if log.has_errors else system


def run(text: str, seed: int, events: int = 8) -> Result:
    """Check, generate and run the machine ``text``, with ``events`` messages at the limits."""
    system = read(text)
    if system is None:
        return Result(text, False)
    machine = system.nodes[0]
    kind = system.library.message("limits/msg/Values")
    draw = Random(seed)
    world = SimulatedWorld(seed)
    oracle = Oracle(machine, system.library, bounds=Bounds(latency=5_000_000, deadline=200_000_000))
    oracle.start(world.now_ns, whole=True)
    verdicts: list[Verdict] = []
    problems: list[str] = []
    sent: list[Observation] = []

    def hear(observation: Observation) -> None:
        if observation.kind is ObservationKind.MESSAGE and observation.source == "Limits":
            sent.append(observation)
        verdicts.extend(oracle.feed(observation))

    listener = SimulatedTransport(world, "listener")
    listener.tap([], hear)
    listener.every(0.01, lambda: verdicts.extend(oracle.advance(world.now_ns)))
    driver = SimulatedTransport(world, "driver")
    publisher = driver.publisher(Topic("/in", kind.name, message_class(kind)))
    logging.getLogger("Limits").setLevel(logging.CRITICAL)
    try:
        nodes = {machine.name: compile_node(machine, system)}
        running = SimulatedRun(Program(nodes, {}, None), world)
        for _ in range(events):
            publisher.publish(value_of(kind, draw))
            running.run(EVENTS_S)
        running.run(0.3)
    except Exception as error:
        problems.append("raised " + "".join(traceback.format_exception(error)[-2:]))
    problems += [f"{item.outcome}: {item.reason}" for item in verdicts]
    problems += [found for item in sent if (found := _cdr_problem(kind, item.data))]
    last: Any = sent[-1].data if sent else {}
    return Result(text, True, tuple(problems), len(sent), last.get("faults", 0), last)


def _cdr_problem(kind: Structure, data: Any) -> str:
    """Why CDR does not carry ``data``; "" if it gives back the same."""
    out = bytearray(HEADER)
    try:
        encoder(kind)(data, out)
    except ValueError as error:
        return f"not CDR: {error!r} {data}"
    back = Decoder(kind)(bytes(out))
    return "" if repr(back) == repr(data) else f"CDR gives {back} for {data}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--models", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    accepted = faults = published = bad = 0
    for seed in range(arguments.seed, arguments.seed + arguments.models):
        found = run(Writer(Random(seed)).machine(), seed)
        accepted += found.accepted
        published += found.published
        faults += bool(found.faults)
        if found.problems:
            bad += 1
            print(f"--- seed {seed}\n{found.text}\n" + "\n".join(found.problems[:3]))
    print(
        f"{accepted} of {arguments.models} accepted, {published} messages, {faults} with faults, {bad} bad"
    )
    sys.exit(bool(bad))


if __name__ == "__main__":
    main()
