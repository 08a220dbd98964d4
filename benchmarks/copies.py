"""Systems of as many nodes as wanted: copies of the lab tour side by side, and further skills for the rest.

``python -m benchmarks.copies NODES FOLDER`` writes one. Each copy has names and channels of its own, and its
tour is one of the policy's trees, which are ticked side by side.
"""

from __future__ import annotations

import argparse
import re
import shutil
from collections.abc import Sequence
from pathlib import Path

from benchmarks.processes import ROOT

TOUR = ROOT / "examples/lab_tour"
FURTHER = TOUR / "skills/WaitSkill.scxml"
"""A skill that needs no other node."""


def write(nodes: int, folder: Path) -> Path:
    """Write a system of ``nodes`` nodes into the new folder ``folder``; its system file."""
    models = sorted([*TOUR.glob("components/*"), *TOUR.glob("skills/*")])
    folder.mkdir(parents=True)
    shutil.copytree(TOUR / "interfaces", folder / "interfaces")
    copies, rest = divmod(nodes, len(models))
    trees = ""
    for copy in range(copies):
        for path in models:
            (folder / f"Tour{copy}{path.name}").write_text(_named(path.read_text(), f"Tour{copy}"))
        policy = _named((TOUR / "policy.xml").read_text(), f"Tour{copy}")
        trees += "".join(re.findall(r"<BehaviorTree .*?</BehaviorTree>", policy, re.DOTALL))
    for number in range(rest):
        text = _named(FURTHER.read_text(), f"Further{number}")
        (folder / f"Further{number}{FURTHER.name}").write_text(text)
    tours = "".join(f'<SubTree ID="Tour{copy}Tour"/>' for copy in range(copies))
    leaf = '<Action ID="ROS2Action" name="Wait" service_name="/Further0WaitSkill/tick"/>'
    (folder / "policy.xml").write_text(
        '<root BTCPP_format="4" main_tree_to_execute="Main"><BehaviorTree ID="Main">'
        f'<ParallelAll max_failures="{max(1, copies)}">{tours or leaf}</ParallelAll>'
        f"</BehaviorTree>{trees}</root>"
    )
    inputs = "".join(
        f'<input type="node-ascxml" src="./{path.name}"/>\n'
        for path in sorted(folder.glob("*.*scxml"))
    )
    system = folder / "system.xml"
    system.write_text(
        '<roaml><parameters><bt_tick_rate value="5"/></parameters>\n'
        '<behavior_tree><input type="bt.cpp-xml" src="./policy.xml"/></behavior_tree>\n'
        f"<node_models>\n{inputs}</node_models>\n"
        '<interfaces><input type="ros-interfaces" src="./interfaces"/></interfaces></roaml>\n'
    )
    return system


def _named(text: str, prefix: str) -> str:
    """The text of a model or policy, with machines, channels and trees of this name before their own."""
    text = re.sub(r"\b(?=\w+(?:Skill|Component)\b)", prefix, text)
    return re.sub(r'\bID="(?=(?:Tour|Battery|PoiScheduler|Navigation)")', f'ID="{prefix}', text)


def main(arguments: Sequence[str] | None = None) -> int:
    """The command."""
    parser = argparse.ArgumentParser(description="Write a system of so many nodes.")
    parser.add_argument("nodes", type=int)
    parser.add_argument("folder", type=Path)
    chosen = parser.parse_args(arguments)
    print(write(chosen.nodes, chosen.folder))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
