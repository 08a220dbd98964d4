"""Events that a machine sends and takes come in the order in which it sends them (W3C SCXML 5.10.1).

That others take one of them makes no difference, nor does how long the transport takes.
"""

from __future__ import annotations

import itertools
from pathlib import Path

import msgspec
import pytest

import m2c
import moon
from m2c.model import DiagnosticLog
from m2c.model.loading import linked
from m2c.model.system import read_with_reference
from m2c.runtime.messages import message_class
from transports import SimulatedWorld, Topic
from transports.simulated import Conditions

HEAD = '<ascxml xmlns="http://www.w3.org/2005/07/scxml" name="{0}" initial="s">'
ORDERS = list(itertools.permutations(("shared", "private", "other")))


def sender(order: tuple[str, ...], wait: str = "100ms", others: str = "") -> str:
    """It sends events in ``order``, and says in which order it takes them."""
    sends = "".join(f'<send event="{name}"><param name="n" expr="n"/></send>' for name in order)
    take = "".join(
        f'<transition event="{name}"><if cond="_event.data.n == n"><send event="took">'
        f'<param name="what" expr="\'{name}\'"/></send></if></transition>'
        for name in order
    )
    return (
        f'{HEAD.format("Sender")}<datamodel><data id="n" type="int16" expr="7"/></datamodel>'
        f'<state id="s"><transition after="{wait}" target="b">{sends}</transition></state>'
        f'<state id="b">{take}{others}</state></ascxml>'
    )


def taker(name: str, *events: str, then: str = "") -> str:
    take = "".join(f'<transition event="{event}">{then}</transition>' for event in events)
    return f'{HEAD.format(name)}<state id="s">{take}</state></ascxml>'


def write(folder: Path, **models: str) -> Path:
    for name, text in models.items():
        (folder / f"{name}.ascxml").write_text(text)
    inputs = "".join(f'<input type="node-ascxml" src="{name}.ascxml"/>' for name in models)
    path = folder / "system.xml"
    path.write_text(f"<roaml><node_models>{inputs}</node_models></roaml>")
    return path


def ran(path: Path, nodes: Path, joins_s: float = 0.0) -> tuple[list[str], list[moon.Verdict]]:
    """What the sender took, in order, and what a monitor of ``path`` says of it."""
    world = SimulatedWorld(4, Conditions(delay_s=(0.0, 0.03)))
    system = m2c.read_system(path)
    verdicts: list[moon.Verdict] = []
    monitor = moon.Monitor(world.connect("monitor"), system, on_verdict=verdicts.append)
    kind = system.library.message("plain_events/msg/Took")
    said: list[str] = []
    topic = Topic("/plain_events/took", kind.name, message_class(kind))
    world.connect("listener").subscribe(topic, lambda message: said.append(message.what))
    run = m2c.simulate(m2c.read_system(nodes), world)
    if joins_s:
        run.run(joins_s)
    monitor.start()
    world.run_for(0.01)
    run.run(4.0)
    return said, [item for item in verdicts if str(item.outcome) == "violated"]


@pytest.mark.parametrize("order", ORDERS, ids="-".join)
def test_own_events_keep_their_order_whoever_else_takes_them(
    order: tuple[str, ...], tmp_path: Path
) -> None:
    path = write(tmp_path, Sender=sender(order), Taker=taker("Taker", "shared", "other"))
    said, violations = ran(path, path)
    assert said == list(order)
    assert violations == []


def test_another_order_is_a_violation(tmp_path: Path) -> None:
    models = tmp_path / "models"
    wrong = tmp_path / "wrong"
    models.mkdir()
    wrong.mkdir()
    path = write(models, Sender=sender(ORDERS[0]), Taker=taker("Taker", "shared", "other"))
    swapped = write(wrong, Sender=sender(ORDERS[3]), Taker=taker("Taker", "shared", "other"))
    _, violations = ran(path, swapped)
    assert {item.node for item in violations} == {"Sender"}


@pytest.mark.parametrize("joins_s", [0.05, 0.5, 1.0, 1.3])
def test_a_monitor_that_comes_later_raises_no_false_alarm(joins_s: float, tmp_path: Path) -> None:
    again = '<transition after="1s" target="s"/>'
    text = sender(ORDERS[0], wait="10ms", others=again)
    path = write(tmp_path, Sender=text, Taker=taker("Taker", "shared", "other"))
    _, violations = ran(path, path, joins_s)
    assert violations == []


def test_an_event_that_others_send_too_reaches_its_sender(tmp_path: Path) -> None:
    also = taker("Other", "took", then='<send event="shared"><param name="n" expr="7"/></send>')
    text = sender(("shared", "private")).replace(
        'event="shared"><if', 'event="shared" target="c"><if'
    )
    text = text.replace(
        "</ascxml>", '<state id="c"><transition event="shared" target="b"/></state></ascxml>'
    )
    path = write(tmp_path, Sender=text, Other=also)
    own = [
        item.own
        for item in m2c.read_system(path).node("Sender").interfaces
        if item.event == "shared"
    ]
    assert own == [False, False]
    said, violations = ran(path, path)
    assert "shared" in said
    assert violations == []


def test_whose_an_event_is_is_found_again_when_a_model_takes_a_nodes_place(tmp_path: Path) -> None:
    path = write(tmp_path, Sender=sender(ORDERS[0]), Taker=taker("Taker", "shared"))
    also = tmp_path / "also.ascxml"
    also.write_text(taker("Also", "shared", then='<send event="shared"/>'))
    system, log = m2c.read_system(path), DiagnosticLog()
    assert owned(system) == {"shared"}
    made = read_with_reference(also, system, "Taker", log)
    assert made is not None
    changed = linked(msgspec.structs.replace(system, nodes=(system.nodes[0], made)), log)
    assert owned(changed) == set()
    back = linked(msgspec.structs.replace(changed, nodes=(changed.nodes[0], system.nodes[1])), log)
    assert owned(back) == {"shared"}


def owned(system: m2c.System) -> set[str]:
    """The events that the sender takes by its own queue, though they are messages."""
    node = system.node("Sender")
    assert node is not None
    return {item.event for item in node.interfaces if item.own}
