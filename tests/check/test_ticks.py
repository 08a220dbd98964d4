"""Ticks and halts: their types are built in, and a package of the user's own keeps their meaning."""

from __future__ import annotations

import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from m2c.check.reading import read_and_check
from m2c.model import DiagnosticLog
from m2c.model.interfaces import InterfaceLibrary

ROOT = Path(__file__).parents[2]
NS = 'xmlns="http://www.w3.org/2005/07/scxml"'
RIGHT = "---\nint8 SUCCESS=0\nint8 FAILURE=1\nint8 RUNNING=2\nint8 status\n"


def skill(package: str) -> str:
    return f"""<scxml {NS} name="Skill" initial="a">
<ros_service_server service_name="/Skill/tick" type="{package}/TickAction"/>
<ros_service_server service_name="/Skill/halt" type="{package}/HaltAction"/>
<state id="a">
  <ros_service_handle_request name="/Skill/tick">
    <ros_service_send_response name="/Skill/tick">
      <field name="status" expr="2"/><field name="is_ok" expr="true"/>
    </ros_service_send_response>
  </ros_service_handle_request>
  <ros_service_handle_request name="/Skill/halt">
    <ros_service_send_response name="/Skill/halt"><field name="is_ok" expr="true"/></ros_service_send_response>
  </ros_service_handle_request>
</state></scxml>"""


def findings(folder: Path, package: str = "bt_interfaces", **definitions: str) -> list[str]:
    """What is said of a system of one skill, with these files of a package of its own."""
    (folder / "skill.scxml").write_text(skill(package))
    (folder / "policy.xml").write_text(
        '<root><BehaviorTree ID="M"><Action ID="A" service_name="/Skill/tick"/></BehaviorTree></root>'
    )
    (folder / "system.xml").write_text(
        '<roaml><behavior_tree><input type="bt.cpp-xml" src="policy.xml"/></behavior_tree>'
        '<node_models><input type="node-ascxml" src="skill.scxml"/></node_models></roaml>'
    )
    for name, text in definitions.items():
        path = folder / "interfaces" / package / "srv" / f"{name}.srv"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    log = DiagnosticLog()
    read_and_check([folder / "system.xml"], [], log)
    return [str(found).replace(f"{folder.resolve()}/", "") for found in log.diagnostics]


@pytest.mark.parametrize("package", ["bt_interfaces", "bt_interfaces_dummy"])
def test_a_first_system_needs_no_interface_package(tmp_path: Path, package: str) -> None:
    assert findings(tmp_path, package) == []


def test_a_package_of_ones_own_takes_the_place_of_the_built_in_one(tmp_path: Path) -> None:
    found = findings(tmp_path, TickAction=RIGHT, HaltAction="---\nbool is_ok\n")
    assert [line.split(" error: ")[1] for line in found] == [
        "<field>: bt_interfaces/srv/TickAction_Response has no field `is_ok`; known: status "
        "[unknown-field]"
    ]


def test_a_package_of_ones_own_is_not_filled_up_from_the_built_in_one(tmp_path: Path) -> None:
    found = findings(tmp_path, TickAction=RIGHT + "bool is_ok\n")
    assert any("unknown type bt_interfaces/srv/HaltAction" in line for line in found)


def test_a_type_of_ones_own_is_meant_before_the_built_in_one_of_that_name(tmp_path: Path) -> None:
    folder = tmp_path / "mine" / "srv"
    folder.mkdir(parents=True)
    (folder / "TickAction.srv").write_text(RIGHT)
    library = InterfaceLibrary.load([tmp_path], DiagnosticLog())
    assert library.names("srv") == [
        "bt_interfaces/srv/HaltAction",
        "bt_interfaces/srv/TickCondition",
        "mine/srv/TickAction",
    ]


@pytest.mark.parametrize(
    ("definition", "said"),
    [
        (
            RIGHT.replace("FAILURE=1", "FAILURE=3") + "bool is_ok\n",
            "srv/TickAction.srv:3:6: error: `FAILURE` of bt_interfaces/srv/TickAction is 3; to a policy, "
            "SUCCESS is 0, FAILURE is 1, RUNNING is 2 [tick-contract]",
        ),
        (
            "---\nint8 SKILL_RUNNING=0\nint8 status\nbool is_ok\n",
            "srv/TickAction.srv:2:6: error: `SKILL_RUNNING` of bt_interfaces/srv/TickAction is 0; to a "
            "policy, SUCCESS is 0, FAILURE is 1, RUNNING is 2 [tick-contract]",
        ),
        (
            "---\nfloat32 status\nbool is_ok\n",
            "srv/TickAction.srv:2:9: error: the response of bt_interfaces/srv/TickAction has no integer "
            "field `status`; a policy reads it: SUCCESS is 0, FAILURE is 1, RUNNING is 2 [tick-contract]",
        ),
    ],
)
def test_a_package_of_ones_own_that_breaks_the_contract_is_refused_where_it_does(
    tmp_path: Path, definition: str, said: str
) -> None:
    found = findings(tmp_path, TickAction=definition, HaltAction="---\nbool is_ok\n")
    assert found == [f"interfaces/bt_interfaces/{said}"]


@pytest.mark.slow
def test_an_installed_wheel_has_the_package(tmp_path: Path) -> None:
    subprocess.run(
        [sys.executable, "-m", "pip", "wheel", "--no-build-isolation", "--no-deps", "-q",
         "-w", str(tmp_path), str(copied(tmp_path / "source"))],
        check=True,
    )  # fmt: skip
    (wheel,) = tmp_path.glob("*.whl")
    names = zipfile.ZipFile(wheel).namelist()
    here = ROOT / "m2c" / "interfaces"
    files = {str(path.relative_to(ROOT)) for path in here.rglob("*") if path.is_file()}
    assert len(files) == 5
    assert files <= set(names)


def copied(folder: Path) -> Path:
    """What a wheel is built from; setuptools leaves files of its own there."""
    tracked = subprocess.run(
        ["git", "ls-files", "-z", "m2c", "setup.py", "pyproject.toml", "README.md"],
        cwd=ROOT, capture_output=True, text=True, check=True,
    )  # fmt: skip
    for name in filter(None, tracked.stdout.split("\0")):
        if (ROOT / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_bytes((ROOT / name).read_bytes())
    return folder
