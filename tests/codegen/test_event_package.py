"""The interface package of plain events, whatever their params are."""

from __future__ import annotations

from m2c.codegen.event_package import event_package
from m2c.codegen.packaging import Packaging
from m2c.diagnostics import Position
from m2c.language.datatypes import FLOAT64, INT64, Array, DataType, Structure
from m2c.model.interfaces import InterfaceLibrary
from m2c.model.machine import Dialect, Interface, InterfaceKind, Machine
from moon.recording.definition_text import definition_text
from moon.recording.definitions import Definitions

HERE = Position("m.scxml")


def files_of(packaging: Packaging, **fields: DataType) -> dict[str, str]:
    """Those of a machine that sends the event ``data``; without the line that says who made them."""
    library = InterfaceLibrary()
    library.define(Structure("plain_events/msg/Data", tuple(fields.items())))
    sent = Interface(
        kind=InterfaceKind.PUBLISHER, name="/plain_events/data", position=HERE,
        channel="/plain_events/data", type_name="plain_events/msg/Data", event="data",
    )  # fmt: skip
    machine = Machine(
        name="M", dialect=Dialect.ASCXML, position=HERE, initial="a", states=(), interfaces=(sent,)
    )
    found = event_package([machine], library, packaging)
    return {
        name: "".join(line for line in text.splitlines(keepends=True) if not line.startswith("#"))
        for name, text in found.items()
    }


POINT = Structure("Point2D", (("x", FLOAT64),))
AREA = Structure("Area", (("corners", Array(POINT, 4, True)),))
STAMP = Structure("builtin_interfaces/msg/Time", (("sec", INT64),))


def test_structures_that_a_system_declares_are_in_the_package_too() -> None:
    found = files_of(Packaging.AMENT, area=AREA, more=Array(POINT, 3), at=STAMP, n=INT64)
    assert found["plain_events/msg/Data.msg"] == (
        "Area area\nPoint2D[<=3] more\nbuiltin_interfaces/Time at\nint64 n\n"
    )
    assert found["plain_events/msg/Area.msg"] == "Point2D[4] corners\n"
    assert found["plain_events/msg/Point2D.msg"] == "float64 x\n"
    assert "  DEPENDENCIES builtin_interfaces\n" in found["plain_events/CMakeLists.txt"]
    assert "<depend>builtin_interfaces</depend>" in found["plain_events/package.xml"]


def test_arrays_of_arrays_have_no_definition() -> None:
    assert files_of(Packaging.WHEEL, rows=Array(Array(INT64))) == {}


def test_recordings_call_such_structures_as_the_package_does() -> None:
    text = definition_text(Structure("plain_events/msg/Data", (("area", Array(AREA)),)))
    assert text.startswith("plain_events/Area[] area\n")
    definitions = Definitions()
    definitions.add("plain_events/msg/Data", "ros2msg", text)
    (area,) = definitions.structure("plain_events/msg/Data").fields
    assert isinstance(area[1], Array)
    assert isinstance(area[1].element, Structure)
    assert area[1].element.name == "plain_events/msg/Area"
