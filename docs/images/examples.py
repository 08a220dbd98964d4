"""Draws behaviour trees, wirings and single machines of the examples, and one beside it, from their models.

Run it after a change of the models: ``python docs/images/examples.py``. A test holds the committed
pictures to what it draws. It is what ``m2c draw`` does, for all pictures at once.
"""

from __future__ import annotations

from pathlib import Path

import m2c
from m2c.draw import document, draw_machine, draw_policy, draw_wiring, tree_of
from m2c.draw.reading import read
from m2c.draw.wiring import Wiring
from m2c.model import DiagnosticLog, Machine
from m2c.policy.tree import PolicyFile

HERE = Path(__file__).parent
EXAMPLES = HERE.parents[1] / "examples"
MACHINES = {
    "charging_station_supply.svg": ("charging_station", "PowerSupply"),
    "lab_tour_skill.svg": ("lab_tour", "SetPoi1Skill"),
    "navigation_controller.svg": ("navigation", "Controller"),
    "sorting_cell_belt.svg": ("sorting_cell", "Belt"),
}
"""The example and the machine in it."""


def pictures() -> dict[str, str]:
    """Every picture of an example: file name → SVG."""
    found = {}
    for name in ("charging_station", "lab_tour", "navigation", "sorting_cell"):
        title = f"The {name.replace('_', ' ')}'s"
        tree = read(EXAMPLES / name / "policy.xml", (), DiagnosticLog())
        system = read(EXAMPLES / name / "system.xml", (), DiagnosticLog())
        assert tree is not None
        assert isinstance(tree.content, PolicyFile)
        assert system is not None
        assert isinstance(system.content, Wiring)
        found[f"{name}_tree.svg"] = document(draw_policy(tree_of(tree.content)), f"{title} policy")
        found[f"{name}_wiring.svg"] = document(draw_wiring(system.content), f"{title} wiring")
    for picture, (name, node) in MACHINES.items():
        machine = m2c.read_system(EXAMPLES / name / "system.xml").node(node)
        assert machine is not None
        found[picture] = document(draw_machine(machine), machine.name)
    nested = read(HERE / "Drive.ascxml", (), DiagnosticLog())
    assert nested is not None
    assert isinstance(nested.content, Machine)
    found["drive.svg"] = document(draw_machine(nested.content), nested.content.name)
    return found


if __name__ == "__main__":
    for name, content in pictures().items():
        (HERE / name).write_text(content, encoding="utf-8")
