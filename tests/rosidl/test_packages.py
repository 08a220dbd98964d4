"""Packages as people have them: incomplete ones are completed, and what cannot be built has its reason."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

from m2c.cli import main
from m2c.rosidl.build import build_interfaces
from m2c.rosidl.packages import NoPackageError, checked, completed, find_packages
from tests.rosidl.test_build import CMAKE, PACKAGE_XML
from tests.systems import EXAMPLES
from tests.transports.ros2_network import have_ticks


def written(folder: Path, **files: str) -> Path:
    """``folder`` with files: ``door__msg__Level="int8 level"`` is ``door/msg/Level.msg``."""
    for name, text in files.items():
        package, kind, last = name.split("__")
        path = folder / package / kind / f"{last}.{kind}"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return folder


def faults(*folders: Path) -> dict[str, str]:
    """What is known against each package in ``folders``, before anything is built."""
    found = checked(find_packages(folders), [Path(sys.prefix)])
    return {package.name: package.fault for package in found}


@pytest.mark.parametrize(
    ("name", "said"),
    [("nowhere", "no such folder"), ("here", r"expected definitions in <package>/msg")],
)
def test_a_folder_without_packages_is_refused_with_what_was_expected(
    tmp_path: Path, name: str, said: str
) -> None:
    (tmp_path / "here").mkdir()
    with pytest.raises(NoPackageError, match=said):
        find_packages([tmp_path / name])


def test_packages_are_found_in_folders_of_folders_and_not_in_what_a_build_left(
    tmp_path: Path,
) -> None:
    written(tmp_path / "robot" / "interfaces", door__msg__Level="int8 level")
    left = written(tmp_path / "build", lamp__msg__Level="int8 level")
    (left / "COLCON_IGNORE").touch()
    assert [package.name for package in find_packages([tmp_path])] == ["door"]


@pytest.mark.parametrize(
    ("files", "said"),
    [
        ({"Door-Msgs__msg__Level": "int8 level"}, "ROS 2 allows no package called `Door-Msgs`"),
        ({"door__msg__Level": "int8"}, "door/msg/Level.msg:1:1: cannot read `int8`"),
        ({"door__msg__level": "int8 level"}, "ROS 2 allows no type called `level`"),
        ({"door__msg__Level": "Hinge hinge"}, "Level.msg:1:1: unknown type door/msg/Hinge"),
        (
            {"door__srv__Open": "---\nhinge_msgs/Hinge hinge\n"},
            "it uses types of `hinge_msgs`, which is neither given here nor installed",
        ),
    ],
)
def test_what_cannot_be_built_is_known_with_its_reason(
    tmp_path: Path, files: dict[str, str], said: str
) -> None:
    (found,) = faults(written(tmp_path, **files)).values()
    assert said in found


def test_a_folder_for_definitions_without_any_is_named(tmp_path: Path) -> None:
    (tmp_path / "door" / "msg").mkdir(parents=True)
    assert faults(tmp_path) == {"door": "it has no .msg, .srv or .action file"}


def test_a_manifest_that_is_not_xml_is_named_with_its_place(tmp_path: Path) -> None:
    written(tmp_path, door__msg__Level="int8 level")
    (tmp_path / "door" / "package.xml").write_text("<package>")
    assert "package.xml:1:10: error: malformed XML" in faults(tmp_path)["door"]


def test_what_uses_a_package_that_is_not_built_is_not_built(tmp_path: Path) -> None:
    files = {"door__msg__Level": "int8", "house__msg__House": "door/Level[] doors"}
    assert faults(written(tmp_path, **files))["house"] == (
        "it uses types of `door`, which is not built"
    )


def test_one_of_two_packages_of_one_name_is_built(tmp_path: Path) -> None:
    for folder in ("a", "b"):
        written(tmp_path / folder, door__msg__Level="int8 level")
    first, second = checked(find_packages([tmp_path]), [])
    assert first.fault == ""
    assert second.fault == f"a second package is called so; the first is {first.folder}"


def test_what_is_missing_is_made_in_a_copy(tmp_path: Path) -> None:
    files = {"door__action__Open": "std_msgs/Header header\n---\n---\nlamp/Level level\n"}
    source = written(tmp_path / "source", **files)
    (package,) = find_packages([source])
    made = completed(package, tmp_path / "made")
    assert [path.name for path in (source / "door").iterdir()] == ["action"]
    cmake = (made / "CMakeLists.txt").read_text()
    assert '"action/Open.action"\n  DEPENDENCIES action_msgs lamp std_msgs\n' in cmake
    assert "<depend>lamp</depend>" in (made / "package.xml").read_text()
    assert find_packages([made])[0].complete


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_built_is_said_of_what_was_imported_and_of_the_rest_why_it_is_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    have_ticks(monkeypatch)
    source = written(
        tmp_path / "source",
        bare__msg__Level="int8 level",
        broken__srv__Tick="---\nint8 status",
        typeless__srv__Tick="---\nbare/Level level\n",
        unlisted__srv__Other="---\n",
        unlisted__srv__Tick="---\n",
        wrong__msg__Level="int8",
    )
    for name in ("broken", "unlisted"):
        (source / name / "package.xml").write_text(PACKAGE_XML.format(name=name))
        (source / name / "CMakeLists.txt").write_text(CMAKE.format(name=name))
    (source / "broken" / "CMakeLists.txt").write_text("nonsense()\n")
    (source / "typeless" / "package.xml").write_text(
        '<package format="3"><name>typeless</name><version>1.0.0</version></package>'
    )
    before = sorted(source.rglob("*"))
    done = CliRunner().invoke(
        main, ["interfaces", "build", str(source), "-o", str(tmp_path / "out")]
    )
    assert done.exit_code == 1, done.output
    assert done.stdout.splitlines()[:3] == [
        "  bare      1 message",
        "  typeless  1 service",
        f"2 packages built into {tmp_path / 'out'}, and imported",
    ]
    said = [line for line in done.stderr.splitlines() if line.startswith("error: ")]
    assert said == [
        "error: broken is not built: colcon could not build it",
        "error: unlisted is not built: built without srv/Other.srv; list it in CMakeLists.txt",
        f"error: wrong is not built: {source}/wrong/msg/Level.msg:1:1: cannot read `int8`; a line is "
        "`type name`, `type name default` or `type NAME=constant`",
    ]
    assert 'Unknown CMake command "nonsense"' in done.stderr
    assert sorted(source.rglob("*")) == before
    code = "from typeless.srv import Tick; from bt_interfaces.srv import TickAction; print(Tick.Response())"
    shell = f'. "{tmp_path}/out/setup.sh" && "{sys.executable}" -c "{code}"'
    used = subprocess.run(["sh", "-c", shell], capture_output=True, text=True, check=True)
    assert "bare.msg.Level(level=0)" in used.stdout


@pytest.mark.slow
@pytest.mark.timeout(400)
def test_it_is_not_built_anew_where_the_ticks_are_installed_elsewhere_too(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    tour = [EXAMPLES / "lab_tour" / "interfaces"]
    output = EXAMPLES.parent / "build" / "interfaces"  # where `make interfaces` puts them
    before = build_interfaces(tour, output)
    have_ticks(monkeypatch)
    again = build_interfaces(tour, output)
    assert again.cached
    assert again.packages == before.packages


def test_what_is_wrong_is_named_from_the_current_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "interfaces/p/msg/A.msg"
    file.parent.mkdir(parents=True)
    file.write_text("int33 x\n")
    monkeypatch.chdir(tmp_path)
    (package,) = checked(find_packages([tmp_path / "interfaces"]), [])
    said = "interfaces/p/msg/A.msg:1:1: unknown type int33; did you mean int32?"
    assert package.fault == said
