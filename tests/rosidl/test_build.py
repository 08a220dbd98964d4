"""Building interface packages with the ROS 2 wheels."""

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from m2c.rosidl.build import (
    CMAKE_ARGUMENTS,
    SETUP_SCRIPT,
    InterfaceBuildError,
    InterfaceInstall,
    build_interfaces,
    build_packages,
    search_path,
)
from m2c.rosidl.colcon import followed
from tests.transports.ros2_network import have_ticks, own_domain

PACKAGE_XML = """<?xml version="1.0"?>
<package format="3">
  <name>{name}</name><version>0.1.0</version><description>test</description>
  <maintainer email="maintainer@example.org">maintainer</maintainer><license>Apache-2.0</license>
  <buildtool_depend>ament_cmake</buildtool_depend>
  <build_depend>rosidl_default_generators</build_depend>
  <exec_depend>rosidl_default_runtime</exec_depend>
  <member_of_group>rosidl_interface_packages</member_of_group>
  <export><build_type>ament_cmake</build_type></export>
</package>
"""
CMAKE = """cmake_minimum_required(VERSION 3.8)
project({name})
find_package(ament_cmake REQUIRED)
find_package(rosidl_default_generators REQUIRED)
rosidl_generate_interfaces(${{PROJECT_NAME}} "srv/Tick.srv")
ament_package()
"""

SERVE_AND_CALL = """
import rclpy
from door_interfaces.srv import Tick

rclpy.init()
node = rclpy.create_node("door")

def tick(request, response):
    response.status = request.door + 1
    return response

service = node.create_service(Tick, "tick", tick)
client = node.create_client(Tick, "tick")
assert client.wait_for_service(timeout_sec=30.0)
future = client.call_async(Tick.Request(door=41))
rclpy.spin_until_future_complete(node, future, timeout_sec=30.0)
print(future.result().status)
node.destroy_node()
rclpy.shutdown()
"""


@pytest.fixture(scope="module")
def packages(tmp_path_factory: pytest.TempPathFactory) -> Path:
    source = tmp_path_factory.mktemp("packages")
    folder = source / "door_interfaces"
    (folder / "srv").mkdir(parents=True)
    (folder / "package.xml").write_text(PACKAGE_XML.format(name="door_interfaces"))
    (folder / "CMakeLists.txt").write_text(CMAKE.format(name="door_interfaces"))
    (folder / "srv" / "Tick.srv").write_text("int8 door\n---\nint8 status\n")
    return source


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("built") / "out"


@pytest.fixture(scope="module")
def built(packages: Path, out: Path) -> Iterator[InterfaceInstall]:
    with pytest.MonkeyPatch.context() as patched:
        have_ticks(patched)
        yield build_interfaces([packages], out)


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_a_built_package_serves_a_real_ros_2_call_and_is_then_cached(
    packages: Path, out: Path, built: InterfaceInstall
) -> None:
    assert built.packages == ("door_interfaces",)
    assert not built.cached
    with own_domain():
        called = subprocess.run(
            [sys.executable, "-c", SERVE_AND_CALL],
            env=built.environment(),
            capture_output=True,
            text=True,
            timeout=100,
            check=False,
        )
    assert called.stdout.split() == ["42"], called.stderr
    script = out / SETUP_SCRIPT
    written = script.stat().st_mtime_ns
    assert build_interfaces([packages], out).cached
    assert script.stat().st_mtime_ns == written  # a shell may be reading it
    script.write_text("of another version")
    assert build_interfaces([packages], out).cached
    assert script.read_text() == built.setup_script()


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_a_program_begins_again_with_packages_that_it_has_built(
    packages: Path, out: Path, built: InterfaceInstall, tmp_path: Path
) -> None:
    program = tmp_path / "program.py"
    program.write_text(
        "import sys\nfrom pathlib import Path\nfrom m2c.rosidl.build import begin_again_with\n"
        f"begin_again_with([Path({str(packages)!r})], Path({str(out)!r}))\n"
        "from door_interfaces.srv import Tick\nfrom rclpy.type_support import "
        "check_for_type_support\ncheck_for_type_support(Tick)\nprint(sys.argv[1:])\n"
    )
    command = [sys.executable, "-W", "error", str(program), "a b", "c"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.stdout == "['a b', 'c']\n", done.stderr


def test_a_folder_that_is_a_link_is_emptied_and_stays_one(
    packages: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    built = tmp_path / "disk" / "built"
    (built / "log").mkdir(parents=True)
    (built / "log" / "lines").write_text("of an earlier build")
    (built / "latest").symlink_to(built / "log")
    (built / "content.sha256").write_text("")
    link = tmp_path / "link"
    link.symlink_to(built)
    monkeypatch.setattr("m2c.rosidl.build._run_colcon", lambda *_: ("nothing is built here",))
    assert build_packages([packages], link).unbuilt
    assert link.is_symlink()
    assert not (built / "log").exists()
    assert not (built / "latest").is_symlink()


def test_a_folder_with_other_content_is_not_emptied(packages: Path, tmp_path: Path) -> None:
    mine = tmp_path / "mine"
    mine.mkdir()
    (mine / "thesis.tex").write_text("years of work")
    with pytest.raises(InterfaceBuildError, match="give a folder of its own"):
        build_interfaces([packages], mine)
    assert (mine / "thesis.tex").read_text() == "years of work"


def test_the_interpreter_is_asked_once_what_it_is_however_often_cmake_looks_for_it(
    tmp_path: Path,
) -> None:
    asked, python = tmp_path / "asked", tmp_path / "python"
    python.write_text(f'#!/bin/sh\necho >> "{asked}"\nexec "{sys.executable}" "$@"\n')
    python.chmod(0o755)
    arguments = [argument.replace(sys.executable, str(python)) for argument in CMAKE_ARGUMENTS]
    counts = []
    for number, looks in enumerate((1, 3)):
        source = tmp_path / str(number)
        source.mkdir()
        look = "find_package(Python3 REQUIRED COMPONENTS Interpreter)\n"
        begin = "cmake_minimum_required(VERSION 3.15)\nproject(door C)\n"
        (source / "CMakeLists.txt").write_text(begin + look * looks)
        asked.write_text("")
        cmake = shutil.which("cmake", path=search_path())
        command = [str(cmake), *arguments, "-B", str(source / "build"), str(source)]
        subprocess.run(command, capture_output=True, check=True)
        counts.append(len(asked.read_text().splitlines()))
    assert counts[0] > 0
    assert counts[1] - counts[0] <= 2  # whether it still runs is asked each time


COLCON = """
import os, sys
print("Starting >>> lamp", flush=True)
with open(sys.argv[1]):  # waits until somebody was told
    pass
os.write(2, b"nonsense\\n")
print("Finished <<< lamp [0.5s]")
print("Failed   <<< door [0.1s, exited with code 1]")
sys.exit(int(sys.argv[2]))
"""


@pytest.mark.parametrize("code", [0, 1])
def test_how_far_a_build_is_is_told_while_it_goes_on(tmp_path: Path, code: int) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    told: list[str] = []

    def tell(line: str) -> None:
        told.append(line)
        if len(told) == 1:
            pipe.open("w").close()

    command = [sys.executable, "-c", COLCON, str(pipe), str(code)]
    found, written = followed(command, os.environ, tmp_path, tell, 60.0)
    assert found == code
    assert told == [
        "Starting >>> lamp",
        "Finished <<< lamp [0.5s]",
        "Failed   <<< door [0.1s, exited with code 1]",
    ]
    assert sorted(written) == sorted([*told, "nonsense"])


def test_a_build_that_hangs_is_ended(tmp_path: Path) -> None:
    command = [sys.executable, "-c", "import threading; threading.Event().wait()"]
    assert followed(command, os.environ, tmp_path, print, 0.2) == (None, ())
