"""ROS 2 nodes as processes: generated ones, and how they end."""

from __future__ import annotations

import contextlib
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from m2c.rosidl.build import build_interfaces
from moon.recording.reader import Recording
from tests.monitor.processes import Process
from transports.conformance import DOUBLE, NUMBERS, Ask, on
from transports.interface import HERE, CallOutcome, Observation, ObservationKind
from transports.networks import PATIENCE_S, ThreadedNetwork
from transports.ros2.graph import UNKNOWN

pytestmark = [pytest.mark.ros2, pytest.mark.slow]

ROOT = Path(__file__).parents[3]
LAB_TOUR = ROOT / "examples" / "lab_tour"
HEARD_S = 120.0
"""A tap has heard by then what is told ten times a second."""
TICK = """
import os

words = os.fdopen(os.dup(1), "w")
os.dup2(2, 1)  # Fast DDS prints what it complains of on stdout

import rclpy
from bt_interfaces.srv import TickCondition
from std_msgs.msg import Int32

rclpy.init()
node = rclpy.create_node("bare")
client = node.create_client(TickCondition, "/BatteryLevelSkill/tick")
publisher = node.create_publisher(Int32, "/BatteryComponent/level", 10)
assert client.wait_for_service(timeout_sec=30.0)
while not publisher.get_subscription_count():
    rclpy.spin_once(node, timeout_sec=0.01)

def tick():
    while True:
        future = client.call_async(TickCondition.Request())
        rclpy.spin_until_future_complete(node, future, timeout_sec=5.0)
        if future.done():
            return future.result()
        client.remove_pending_request(future)  # the first answer may go to nobody: DDS is matching

assert tick() == TickCondition.Response(status=TickCondition.Response.SUCCESS, is_ok=True)
publisher.publish(Int32(data=5))
while tick().status != TickCondition.Response.FAILURE:
    pass
print("ticked", file=words)
node.destroy_node()
rclpy.shutdown()
"""


def start(name: str, how: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "tests.transports.ros2_peer", name, how],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        text=True,
    )


def say(process: subprocess.Popen[str], word: str) -> None:
    assert process.stdout is not None
    assert process.stdout.readline().strip() == word


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_node_that_waits_for_ever_ends_at_a_signal(number: signal.Signals) -> None:
    with start("peer", "serve") as process:
        say(process, "spins")
        process.send_signal(number)
        say(process, "closed")
        assert process.wait(PATIENCE_S) == 0


def test_a_process_that_forgets_to_close_ends() -> None:
    with start("peer", "leave") as process:
        say(process, "left")
        assert process.wait(PATIENCE_S) == 0


def test_what_a_node_published_last_arrives_although_it_ends(network: ThreadedNetwork) -> None:
    node = network.node("node")
    heard: list[int] = []
    on(network, node, lambda: node.subscribe(NUMBERS, lambda message: heard.append(message.value)))
    on(network, node, node.announce)
    with start("peer", "publish") as process:
        assert process.wait(PATIENCE_S) == 0
    assert network.until(lambda: heard == list(range(500)))


def mailboxes_of_names() -> set[Path]:
    """Where Fast DDS hears this process's participants what the nodes of the others are called; the
    files by which each of them is held.
    """
    held = {item.resolve() for item in Path("/proc/self/fd").iterdir()}
    return {path for path in held if re.fullmatch(r"fastrtps_port7[0-3]\d\d_el", path.name)}


def test_who_never_hears_how_nodes_are_called_knows_who_is_up(network: ThreadedNetwork) -> None:
    before = mailboxes_of_names()
    node = network.node("node")
    (held,) = mailboxes_of_names() - before
    # as Fast DDS does it to the one when others begin and end at the same moment
    held.unlink()
    held.with_name(held.name.removesuffix("_el")).unlink()
    client = on(network, node, lambda: node.client(DOUBLE))
    sources: set[str] = set()
    tap = on(network, node, lambda: node.tap(["/**"], lambda seen: sources.add(seen.source)))
    with start("peer", "serve") as process:
        assert not node.wait_for_nodes(["peer"], PATIENCE_S)

        def is_heard() -> bool:  # the peer records its calls once it knows of the tap
            answer = network.caller(lambda: client.call_and_wait(Ask(4), PATIENCE_S))()
            assert answer.response.value == 8
            return "peer" in sources

        assert network.until(is_heard)
        assert "peer" not in node.ros_node.get_node_names(), "this should be what is tested"
        assert "peer" in tap.peers()
        (publisher,) = node.ros_node.get_publishers_info_by_topic(NUMBERS.name)
        assert publisher.node_name == UNKNOWN
        assert node._graph.name_of(publisher) == "peer"
        process.send_signal(signal.SIGINT)
        assert process.wait(PATIENCE_S) == 0


def test_a_server_in_another_process_answers_and_its_end_is_noticed(
    network: ThreadedNetwork,
) -> None:
    node = network.node("node")
    changes: list[tuple[str, bool]] = []
    on(network, node, lambda: node.watch_nodes(lambda *change: changes.append(change)))
    client = on(network, node, lambda: node.client(DOUBLE))
    with start("peer", "serve") as process:
        assert not node.wait_for_nodes(["peer"], PATIENCE_S)
        answer = network.caller(lambda: client.call_and_wait(Ask(4), PATIENCE_S))()
        assert answer.response.value == 8
        assert 0 < node.up_since("peer") < node.now_ns()
        assert [node.clock_of(name) for name in ("", "peer", "nobody")] == [HERE, HERE, ""]
        process.send_signal(signal.SIGINT)
        assert process.wait(PATIENCE_S) == 0
    assert network.until(lambda: changes == [("peer", True), ("peer", False)])
    # As soon as the graph shows nobody who serves, a call says so at once.
    assert network.until(
        lambda: client.call_and_wait(Ask(4), 1.0).outcome is CallOutcome.UNAVAILABLE
    )


def test_a_call_to_a_process_that_stands_still_times_out(network: ThreadedNetwork) -> None:
    """As with one that was killed, whose part of the shared memory would be left behind here."""
    node = network.node("node")
    client = on(network, node, lambda: node.client(DOUBLE))
    with start("peer", "serve") as process:
        assert not node.wait_for_nodes(["peer"], PATIENCE_S)
        process.send_signal(signal.SIGSTOP)
        assert client.call_and_wait(Ask(1), 0.5).outcome is CallOutcome.TIMEOUT
        process.send_signal(signal.SIGCONT)
        process.send_signal(signal.SIGINT)
        assert process.wait(PATIENCE_S) == 0


@pytest.fixture(scope="module")
def lab_tour() -> dict[str, str]:
    """The environment in which the lab tour's packages are found."""
    install = build_interfaces([LAB_TOUR / "interfaces"], ROOT / "build" / "interfaces")
    return install.environment(os.environ)


@pytest.mark.timeout(400)
def test_a_shell_that_sources_the_setup_script_finds_the_packages(
    lab_tour: dict[str, str],
) -> None:
    code = "from bt_interfaces.srv import TickAction; print(TickAction.Response(status=2))"
    done = subprocess.run(
        ["bash", "-euc", f'. build/interfaces/setup.sh; "{sys.executable}" -c "{code}"'],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.strip() == "bt_interfaces.srv.TickAction_Response(status=2, is_ok=False)"


@pytest.mark.timeout(400)
def test_a_generated_skill_is_ticked_by_an_ordinary_client(
    lab_tour: dict[str, str], tmp_path: Path
) -> None:
    m2c = [sys.executable, "-m", "m2c.cli"]
    model = [str(LAB_TOUR / "skills" / "BatteryLevelSkill.scxml")]
    folders = ["--interfaces", str(LAB_TOUR / "interfaces"), "--transport", "ros2"]
    subprocess.run(
        [*m2c, "generate", *model, *folders, "-o", str(tmp_path)], check=True, capture_output=True
    )
    as_launched = ["--ros-args", "-r", "__node:=battery", "-p", "use_sim_time:=false"]
    with subprocess.Popen(
        [sys.executable, "-m", "battery_level_skill", "--transport", "ros2", *as_launched],
        cwd=tmp_path / "battery_level_skill",
        env=lab_tour,
    ) as skill:
        ticked = subprocess.run(
            [sys.executable, "-c", TICK],
            env=lab_tour,
            capture_output=True,
            text=True,
            timeout=100,
            check=False,
        )
        skill.send_signal(signal.SIGINT)
        assert skill.wait(PATIENCE_S) == 0
    assert ticked.stdout.strip() == "ticked", ticked.stderr


def until_said(process: Process, text: str) -> None:
    process.until(lambda: any(text in line for line in process.out), HEARD_S)


@pytest.mark.timeout(400)
def test_the_lab_tour_runs_and_is_heard(lab_tour: dict[str, str]) -> None:
    """Seventeen nodes and a policy; a tap hears the tree's ticks and what they make skills do.

    The tree is ticked until all of that was heard, and until `m2c run` itself was told of a tick: the policy
    waits for its nodes, not for those two to discover it, each of which takes DDS seconds more where it
    drops something on a busy machine.
    """
    wanted = ("/BatteryLevelSkill/tick", "/BlackboardComponent/GetInt", "/policy/ticks")
    over_ros = ["--transport", "ros2"]
    with (
        contextlib.closing(Process("moon", "tap", *over_ros, "--json", env=lab_tour)) as tap,
        contextlib.closing(
            Process("m2c", "run", LAB_TOUR / "system.xml", *over_ros, "--rate", 10, env=lab_tour)
        ) as run,
    ):
        for channel in wanted:
            until_said(tap, f'"channel":"{channel}"')
        until_said(run, "tick ")
        assert run.end(signal.SIGINT) == 0, run.said
        assert tap.end(signal.SIGINT) == 0, tap.said
    last_shown = [line.split()[1] for line in run.out if line.startswith("tick ")][-1]
    ticks = "1 tick" if last_shown == "1" else f"{last_shown} ticks"
    assert run.out[-1].strip() == f"stopped after {ticks}; all nodes have ended", run.said


@pytest.mark.timeout(400)
def test_a_run_is_recorded_from_the_first_message_of_each_channel_on(
    lab_tour: dict[str, str], tmp_path: Path
) -> None:
    recording = tmp_path / "run.mcap"
    run = Process(
        *("m2c", "run", LAB_TOUR / "system.xml", "--transport", "ros2"),
        *("--ticks", 5, "--record", recording),
        env=lab_tour,
    )
    with contextlib.closing(run):
        assert run.end() == 0, run.said
    first: dict[tuple[str, str], int] = {}
    with Recording.open(recording) as recorded:
        for entry in recorded.entries():
            if isinstance(entry, Observation) and entry.kind is ObservationKind.MESSAGE:
                first.setdefault((entry.source, entry.channel), entry.sequence)
    assert first.get(("policy", "/policy/ticks")) == 0, run.said
    assert set(first.values()) == {0}, first


ONLY = [word for name in ("BatteryLevelSkill", "policy") for word in ("--only", name)]


@pytest.mark.parametrize("processes", ["1", "each"])
def test_every_tick_is_shown_and_counted(lab_tour: dict[str, str], processes: str) -> None:
    run = Process(
        *("m2c", "run", LAB_TOUR / "system.xml", "--transport", "ros2", *ONLY),
        *("--processes", processes, "--rate", 50, "--ticks", 5),
        env=lab_tour,
    )
    with contextlib.closing(run):
        assert run.end() == 0, run.said
    shown = [int(line.split()[1]) for line in run.out if line.startswith("tick ")]
    assert shown == [1, 2, 3, 4, 5], run.said
    assert run.out[-1].strip() == "stopped after 5 ticks; all nodes have ended", run.said


@pytest.mark.timeout(400)
def test_a_node_that_dies_in_a_shared_process_is_named_and_logs_where_ros_does(
    lab_tour: dict[str, str], tmp_path: Path
) -> None:
    folder = tmp_path / "system"
    command = [sys.executable, "-m", "m2c.cli", "generate", str(LAB_TOUR / "system.xml")]
    command += ["--transport", "ros2", "-o", str(folder)]
    subprocess.run(command, check=True, capture_output=True)
    node = folder / "battery_level_skill" / "battery_level_skill" / "machine.py"
    text = node.read_text()
    assert "status=self.SUCCESS" in text
    node.write_text(text.replace("status=self.SUCCESS", "status=1 // 0"))
    run = Process(
        *("m2c", "run", folder, "--transport", "ros2", *ONLY, "--processes", 1), env=lab_tour
    )
    with contextlib.closing(run):
        assert run.end() == 1, run.said
    assert re.search(r"\[FATAL\] \[[\d.]+\] \[BatteryLevelSkill\]: it died", run.said)
    assert "BatteryLevelSkill (in process 1, with policy) exited with code 1" in run.said, run.said
