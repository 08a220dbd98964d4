"""``m2c run`` on ROS 2 ends at a signal whatever it is doing, and leaves no shared memory behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from m2c.rosidl.build import build_interfaces
from tests.transports.shared_memory import left_over, segments
from transports import watchdog

pytestmark = [pytest.mark.ros2, pytest.mark.slow, pytest.mark.timeout(300)]

ROOT = Path(__file__).parents[3]
LAB_TOUR = ROOT / "examples" / "lab_tour"
M2C = (sys.executable, "-m", "m2c.cli")
NODES = ("BatteryComponent", "BatteryLevelSkill", "policy")
LIMIT_S = 60.0
"""After so long a run is killed, and its test fails."""

TOLD_WHILE_IT_CONNECTS = """
import os, signal
import rclpy
create_node = rclpy.create_node
def create_and_be_told(*arguments, **more):
    os.kill(os.getpid(), signal.SIGTERM)
    return create_node(*arguments, **more)
rclpy.create_node = create_and_be_told
"""
TOLD_WHILE_IT_WAITS = """
import os, signal
from transports.ros2.announcements import Announcements
watch = Announcements.watch
def watch_and_be_told(announcements, handler):
    watch(announcements, handler)
    os.kill(os.getpid(), signal.SIGTERM)
Announcements.watch = watch_and_be_told
"""


@pytest.fixture(scope="module")
def environment() -> dict[str, str]:
    """In which the lab tour's packages are found."""
    install = build_interfaces([LAB_TOUR / "interfaces"], ROOT / "build" / "interfaces")
    return install.environment(os.environ)


@pytest.fixture(scope="module")
def generated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("generated")
    subprocess.run(
        [*M2C, "generate", str(LAB_TOUR / "system.xml"), "-o", str(folder)],
        check=True,
        capture_output=True,
    )
    return folder


@pytest.fixture
def left_before() -> set[str]:
    """What others have left in shared memory."""
    return segments()


@pytest.mark.parametrize(
    "number", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.soak)]
)
@pytest.mark.parametrize(
    "said", ["starting 2 nodes", "2 nodes are up", "ticking the tree", "tick "]
)
def test_a_signal_ends_a_run_at_any_stage(
    said: str,
    number: signal.Signals,
    generated: Path,
    environment: dict[str, str],
    left_before: set[str],
) -> None:
    only = [part for node in NODES for part in ("--only", node)]
    with subprocess.Popen(
        [*M2C, "run", str(generated), "--transport", "ros2", *only],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    ) as process:
        assert process.stdout is not None
        lines = []
        for line in process.stdout:
            lines.append(line)
            if said in line:
                break
        process.send_signal(number)
        try:
            rest, _ = process.communicate(timeout=LIMIT_S)
        finally:
            process.kill()
    text = "".join(lines) + rest
    assert text.splitlines()[-1].endswith("all nodes have ended"), text
    assert process.returncode == 0
    assert "killed" not in text
    assert not left_over(left_before)


def check_ends(code: str, package: Path, arguments: list[str], environment: dict[str, str]) -> None:
    """Run ``package`` under ``code``, which has it told to end; it ends well, and in time."""
    before = segments()
    run = f"import runpy; runpy.run_module({package.name!r}, run_name='__main__')"
    done = subprocess.run(
        [sys.executable, "-c", f"{code}\n{run}", "--transport", "ros2", *arguments],
        cwd=package,
        env=environment,
        capture_output=True,
        text=True,
        timeout=LIMIT_S,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert not left_over(before)


@pytest.mark.parametrize("package", ["battery_component", "lab_tour_policy"])
def test_a_process_that_is_to_end_while_it_connects_does_so_when_it_is_connected(
    package: str, generated: Path, environment: dict[str, str]
) -> None:
    check_ends(TOLD_WHILE_IT_CONNECTS, generated / package, [], environment)


def test_a_policy_whose_nodes_do_not_come_ends_at_a_signal(
    generated: Path, environment: dict[str, str]
) -> None:
    policy = generated / "lab_tour_policy"
    arguments = ["--wait-for", "Nobody"]
    check_ends(TOLD_WHILE_IT_WAITS, policy, arguments, environment)


HELD_AS_IT_CLOSES = """
import ctypes
from transports.ros2 import connect, transport
transport._DESTROY_S = 0.5
node = connect("stuck", {})
destroy_node = node.ros_node.destroy_node
def destroy_and_hold():
    destroy_node()
    ctypes.PyDLL(None).pause()  # called with the interpreter's lock in hand, and never returns
node.ros_node.destroy_node = destroy_and_hold
node.close()
"""


def test_a_node_that_ros_does_not_let_go_of_ends_and_says_why(left_before: set[str]) -> None:
    """Some builds of Fast DDS wait for ever as a participant is destroyed, and rclpy holds the lock meanwhile."""
    done = subprocess.run(
        [sys.executable, "-c", HELD_AS_IT_CLOSES],
        capture_output=True,
        text=True,
        timeout=LIMIT_S,
        check=False,
    )
    (line,) = done.stderr.splitlines()
    reason = "stuck: destroying the ROS 2 node takes longer than 0.5 s; the process is ended"
    assert line.endswith(f": {reason}")
    assert done.returncode == watchdog.EXIT_CODE
    assert not left_over(left_before)


def test_no_cpp_is_called_by_name() -> None:
    """What is called is C API of rcl, rmw, rcutils and the C library."""
    import transports

    (folder,) = transports.__path__
    assert not [path for path in Path(folder).rglob("*.py") if "_ZN" in path.read_text()]
