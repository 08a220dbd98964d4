"""Draws the lab tour's behaviour tree, its wiring and a skill, from the example's own models.

Run it after a change of the models: ``python docs/images/lab_tour.py``. A test holds the committed
pictures to what it draws. It is what ``m2c draw`` does, for all pictures at once.
"""

from __future__ import annotations

from pathlib import Path

from m2c.draw import document, draw_machine, draw_policy, draw_wiring, tree_of
from m2c.draw.reading import read
from m2c.draw.wiring import Wiring
from m2c.model import DiagnosticLog, Machine
from m2c.policy.tree import PolicyFile

HERE = Path(__file__).parent
EXAMPLE = HERE.parents[1] / "examples" / "lab_tour"


def pictures() -> dict[str, str]:
    """Every picture of the lab tour: file name → SVG."""
    tree = read(EXAMPLE / "policy.xml", (), DiagnosticLog())
    system = read(EXAMPLE / "system.xml", (), DiagnosticLog())
    skill = read(EXAMPLE / "skills" / "SetPoi1Skill.scxml", (), DiagnosticLog())
    assert tree is not None
    assert isinstance(tree.content, PolicyFile)
    assert system is not None
    assert isinstance(system.content, Wiring)
    assert skill is not None
    assert isinstance(skill.content, Machine)
    return {
        "lab_tour_skill.svg": document(draw_machine(skill.content), skill.name),
        "lab_tour_tree.svg": document(draw_policy(tree_of(tree.content)), "The lab tour's policy"),
        "lab_tour_wiring.svg": document(draw_wiring(system.content), "The lab tour's wiring"),
    }


if __name__ == "__main__":
    for name, content in pictures().items():
        (HERE / name).write_text(content, encoding="utf-8")
