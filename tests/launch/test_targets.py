"""``<send target="X">``: the machine X of the system gets the event, and no other."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

import m2c
from m2c.model import DiagnosticLog
from m2c.model.loading import linked
from m2c.model.machine import InterfaceKind
from m2c.model.system import read_with_reference
from tests.launch.test_own_events import HEAD, ran, taker, write
from tests.model.test_reader_messages import findings

SAY = '<send event="took"><param name="what" expr="\'{0}\'"/></send>'


def sends(*lines: str, take: str = "", name: str = "Sender", start: str = "100ms") -> str:
    go = f'<state id="s"><transition after="{start}" target="b">{"".join(lines)}</transition></state>'
    data = '<datamodel><data id="n" type="int16" expr="7"/></datamodel>'
    return f'{HEAD.format(name)}{data}{go}<state id="b">{take}</state></ascxml>'


def send(event: str, target: str = "", more: str = "") -> str:
    to = f' target="{target}"' if target else ""
    return f'<send event="{event}"{to}{more}><param name="n" expr="n"/></send>'


def says(name: str, event: str = "go") -> str:
    return taker(name, event, then=SAY.format(name))


def complaints(path: Path) -> list[str]:
    return [str(item) for item in m2c.read_system(path).findings if item.severity != "note"]


@pytest.mark.parametrize(
    ("targets", "took"),
    [
        (("A",), {"A"}),
        (("B",), {"B"}),
        (("",), {"A", "B"}),
        (("A", "B"), {"A", "B"}),
        (("Sender",), {"Sender"}),
        (("A", "Sender"), {"A", "Sender"}),
    ],
)
def test_only_the_machine_that_is_named_gets_the_event(
    targets: tuple[str, ...], took: set[str], tmp_path: Path
) -> None:
    own = f'<transition event="go">{SAY.format("Sender")}</transition>' if "Sender" in took else ""
    text = sends(*(send("go", target) for target in targets), take=own)
    path = write(tmp_path, Sender=text, A=says("A"), B=says("B", "g* go"))
    assert complaints(path) == []
    said, violations = ran(path, path)
    assert violations == []
    assert sorted(said) == sorted(took)


def test_an_event_is_sent_to_one_and_to_all(tmp_path: Path) -> None:
    text = sends(send("go", "A"), send("go"))
    path = write(tmp_path, Sender=text, A=says("A"), B=says("B"))
    channels = {
        node.name: sorted(
            item.channel or "" for item in node.interfaces if item.kind is InterfaceKind.SUBSCRIBER
        )
        for node in m2c.read_system(path).nodes
    }
    assert channels == {
        "Sender": [],
        "A": ["/plain_events/go", "/plain_events_to/A/go"],
        "B": ["/plain_events/go"],
    }
    said, violations = ran(path, path)
    assert (sorted(said), violations) == (["A", "A", "B"], [])


def test_both_have_one_type(tmp_path: Path) -> None:
    text = sends(send("go", "A"), '<send event="go"><param name="x" expr="0.5"/></send>')
    path = write(tmp_path, Sender=text, A=says("A"), B=says("B"))
    (kind,) = (item for item in m2c.read_system(path).library.defined() if item.name.endswith("Go"))
    assert [name for name, _ in kind.fields] == ["n", "x"]


def test_a_monitor_sees_that_another_machine_was_meant(tmp_path: Path) -> None:
    right, wrong = tmp_path / "right", tmp_path / "wrong"
    right.mkdir()
    wrong.mkdir()
    machines = {"A": says("A"), "B": says("B")}
    path = write(right, Sender=sends(send("go", "A")), **machines)
    other = write(wrong, Sender=sends(send("go", "B")), **machines)
    _, violations = ran(path, other)
    assert "Sender" in {item.node for item in violations}


def test_an_event_that_goes_to_another_machine_is_not_delayed(tmp_path: Path) -> None:
    text = sends(send("go", "A", ' delay="1s"'))
    path = write(tmp_path, Sender=text, A=says("A"))
    assert any("[unsupported-event]" in line for line in findings(path))


def test_its_own_name_may_stand_at_a_delayed_event(tmp_path: Path) -> None:
    own = f'<transition event="go">{SAY.format("Sender")}</transition>'
    text = sends(send("go", "Sender", ' delay="500ms"'), take=own)
    path = write(tmp_path, Sender=text, A=says("A"))
    assert complaints(path) == []
    assert ran(path, path) == (["Sender"], [])


@pytest.mark.parametrize(
    ("target", "hint"), [("AA", "did you mean A?"), ("Elsewhere", "known: A, B")]
)
def test_a_machine_that_is_not_there_is_a_warning(target: str, hint: str, tmp_path: Path) -> None:
    path = write(tmp_path, Sender=sends(send("go", target)), A=says("A"), B=says("B"))
    lines = [line for line in findings(path) if "unknown-machine" in line]
    assert len(lines) == 1
    assert f"`go` is sent to `{target}`, and no such machine was read; {hint}" in lines[0]


def test_a_system_that_was_linked_stays_as_it_is(tmp_path: Path) -> None:
    path = write(tmp_path, Sender=sends(send("go", "A"), send("go")), A=says("A"), B=says("B"))
    system, log = m2c.read_system(path), DiagnosticLog()
    assert linked(system, log) == system
    also = tmp_path / "also.ascxml"
    also.write_text(sends(send("go", "B"), name="Also"))
    made = read_with_reference(also, system, "Sender", log)
    assert made is not None
    nodes = (made, *system.nodes[1:])
    again = linked(msgspec.structs.replace(system, nodes=nodes), log)
    heard = {item.channel for node in again.nodes for item in node.interfaces}
    assert "/plain_events_to/B/go" in heard
    assert log.diagnostics == []
