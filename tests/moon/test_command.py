"""``moon tap`` as a process of its own, on real Zenoh over loopback."""

from __future__ import annotations

import json
import os
import pty
import signal
import socket
import subprocess
import sys
import threading
from contextlib import contextmanager, suppress
from pathlib import Path

import msgspec
import pytest

from transports.interface import Action, GoalEvents, Service, Topic
from transports.zenoh import connect
from transports.zenoh_link.session import open_session

pytestmark = pytest.mark.zenoh
MOON = [sys.executable, "-m", "moon.cli"]
WAIT_S = 30.0
"""How long a test waits for what must happen; only a failing test waits that long."""


class Number(msgspec.Struct):
    data: int = 0


class AddRequest(msgspec.Struct):
    a: int = 0
    b: int = 0


class AddResponse(msgspec.Struct):
    total: int = 0


Number.__type_name__ = "std_msgs/msg/Int32"
COUNT = Topic("/adder/count", "std_msgs/msg/Int32", Number)
ADD = Service("/adder/add", "test_interfaces/srv/Add", AddRequest, AddResponse)
GO = Action("/adder/go", "test_interfaces/action/Go", Number, Number, Number)


def free_endpoint() -> str:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{free.getsockname()[1]}"


class Robot:
    """Two nodes, `adder` and `caller`, that publish, call and send goals until they are closed."""

    def __init__(self) -> None:
        self.endpoint = free_endpoint()
        self.adder = connect("adder", {"listen": self.endpoint})
        self.caller = connect("caller", {"endpoint": self.endpoint})
        self.count = self.adder.publisher(COUNT)
        self.adder.serve(ADD, lambda r: r.respond(AddResponse(r.data.a + r.data.b)))
        self.adder.serve_action(GO, self._go, lambda goal: goal.canceled(Number(0)))
        self._add = self.caller.client(ADD)
        self._goals = self.caller.action_client(GO)
        self._published = 0
        self._threads = [threading.Thread(target=node.spin) for node in (self.adder, self.caller)]
        for thread in self._threads:
            thread.start()
        for node in (self.adder, self.caller):
            node.announce()
        assert not self.caller.wait_for_nodes(["adder"], WAIT_S)

    def work(self) -> None:
        """Do each thing once, 50 times a second."""
        nothing = GoalEvents(*[lambda *_: None] * 5)
        self.adder.every(0.02, self._publish)
        self.caller.every(0.02, lambda: self._add.call(AddRequest(1, 2), lambda _: None))
        self.caller.every(0.02, lambda: self._goals.send_goal(Number(5), nothing))

    def _publish(self) -> None:
        self.count.publish(Number(self._published))
        self._published += 1

    def _go(self, goal) -> None:
        goal.accept()
        goal.publish_feedback(Number(4))
        goal.succeed(Number(6))

    def close(self) -> None:
        for node in (self.caller, self.adder):
            node.close()
        for thread in self._threads:
            thread.join(WAIT_S)
            assert not thread.is_alive()


class Hub:
    """Somebody who listens at an endpoint, and is no node."""

    def __init__(self) -> None:
        self.endpoint = free_endpoint()
        self._session = open_session({"listen": self.endpoint})

    def close(self) -> None:
        self._session.close()


@pytest.fixture
def hub():
    opened = Hub()
    yield opened
    opened.close()


@pytest.fixture
def robot():
    opened = Robot()
    yield opened
    opened.close()


@pytest.fixture
def working(robot):
    robot.work()
    return robot


def run(robot: Robot, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run ``moon tap`` to its end."""
    return subprocess.run(
        [*MOON, "tap", "--endpoint", robot.endpoint, *arguments],
        capture_output=True,
        text=True,
        timeout=WAIT_S,
        check=False,
    )


@contextmanager
def running(robot: Robot | Hub, *arguments: str, **options):
    """``moon tap`` while it runs; killed if the test fails before its end."""
    options = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE} | options
    process = subprocess.Popen(
        [*MOON, "tap", "--endpoint", robot.endpoint, *arguments], text=True, **options
    )
    try:
        yield process
    finally:
        if process.poll() is None:
            process.kill()
        process.communicate()


def objects(result: subprocess.CompletedProcess[str]) -> list[dict]:
    assert result.returncode == 0, result.stderr
    return [json.loads(text) for text in result.stdout.splitlines()]


def test_json_is_one_object_a_line_with_all_that_is_known(working) -> None:
    shown = objects(run(working, "--json", "--count", "100"))
    assert len(shown) == 100
    message = next(line for line in shown if line["channel"] == "/adder/count")
    assert message["kind"] == "message"
    assert message["source"] == "adder"
    assert message["type_name"] == "std_msgs/msg/Int32"
    assert isinstance(message["data"]["data"], int)
    assert message["received_ns"] > 0
    request = next(
        line for line in shown if (line["channel"], line["kind"]) == ("/adder/add", "request")
    )
    assert (request["source"], request["data"]) == ("caller", {"a": 1, "b": 2})
    response = next(
        line for line in shown if line["kind"] == "response" and "round_trip_us" in line
    )
    assert response["client"] == "caller"
    assert response["round_trip_us"] > 0


def test_the_answerer_of_every_response_is_the_server(working) -> None:
    shown = objects(run(working, "--json", "--kind", "response", "--count", "60"))
    assert {(line["source"], line["client"]) for line in shown} == {("adder", "caller")}


def test_a_channel_glob_lets_only_its_channels_through(working) -> None:
    shown = objects(run(working, "/adder/count", "--json", "--count", "5"))
    assert {line["channel"] for line in shown} == {"/adder/count"}
    numbers = [line["data"]["data"] for line in shown]
    assert numbers == list(range(numbers[0], numbers[0] + 5))


def test_the_name_of_an_action_selects_all_its_parts(working) -> None:
    shown = objects(run(working, "/adder/go", "--json", "--count", "100"))
    assert {line["action"] for line in shown} == {"/adder/go"}
    parts = {"goal", "goal response", "feedback", "result request", "result", "status"}
    assert {line["part"] for line in shown} == parts


def test_kind_action_selects_every_part_and_nothing_else(working) -> None:
    shown = objects(run(working, "--kind", "action", "--json", "--count", "60"))
    assert {line["action"] for line in shown} == {"/adder/go"}


def test_a_node_is_selected_as_the_one_that_asks(working) -> None:
    shown = objects(run(working, "--node", "call*", "--json", "--count", "40"))
    assert all("caller" in (line["source"], line.get("client")) for line in shown)
    assert {line["kind"] for line in shown} == {"request", "response"}


def test_a_node_is_selected_as_the_one_that_answers(working) -> None:
    shown = objects(run(working, "/adder/add", "--node", "adder", "--json", "--count", "20"))
    assert {line["kind"] for line in shown} == {"response"}


def test_text_is_a_line_for_each_event_and_a_summary_beside_it(working) -> None:
    result = run(working, "/adder/add", "--count", "6")
    assert result.returncode == 0
    shown = result.stdout.splitlines()
    assert len(shown) == 6
    assert any("→ caller" in text and "a: 1, b: 2" in text for text in shown)
    assert any("← adder" in text and "total: 3" in text and "µs)" in text for text in shown)
    assert result.stderr.splitlines()[-1].endswith("showed 6 events")


def test_statistics_are_a_table_at_the_end(working) -> None:
    result = run(working, "--stats", "--count", "200")
    heading, *rows = result.stdout.splitlines()
    assert heading.split()[:2] == ["channel", "count"]
    named = {row.partition("  ")[0].strip(): row.split() for row in rows}
    assert {"/adder/add", "/adder/count", "/adder/go (goal)", "/adder/go (feedback)"} <= set(named)
    assert int(named["/adder/count"][1]) > 0


def test_statistics_as_json_are_an_object_for_each_channel(working) -> None:
    rows = {
        row["channel"]: row for row in objects(run(working, "--stats", "--json", "--count", "99"))
    }
    assert rows["/adder/add"]["p50_us"] > 0
    assert rows["/adder/count"]["p50_us"] is None


def test_statistics_on_a_terminal_are_refreshed_in_place(working) -> None:
    ours, theirs = pty.openpty()
    try:
        with running(working, "--stats", stdout=theirs) as process:
            os.close(theirs)
            drawn = b""
            while drawn.count(b"/adder/count") < 3:
                drawn += os.read(ours, 4096)
            process.send_signal(signal.SIGINT)
            try:
                while more := os.read(ours, 4096):
                    drawn += more
            except OSError:  # the other side of the terminal is closed: the process has ended
                pass
            assert process.wait(WAIT_S) == 0
    finally:
        os.close(ours)
    assert b"\x1b[1A" in drawn  # up, over what was drawn before
    assert drawn.rstrip().endswith(b"\x1b[?25h")  # the cursor is shown again


def test_a_time_limit_ends_it(working) -> None:
    result = run(working, "--for", "0.2")
    assert result.returncode == 0
    assert " observations in " in result.stderr.splitlines()[-1]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_it_with_a_summary(working, number) -> None:
    with running(working) as process:
        assert process.stdout.readline()
        process.send_signal(number)
        _, told = process.communicate(timeout=WAIT_S)
        assert process.returncode == 0
    assert told.splitlines()[-1].startswith("received ")


def test_a_reader_that_leaves_ends_it_quietly(working) -> None:
    with running(working) as process:
        assert process.stdout.readline()
        process.stdout.close()
        assert process.wait(WAIT_S) == 0
        told = process.stderr.read()
    assert "Traceback" not in told
    assert "error" not in told.lower()


def test_a_reader_that_leaves_while_nothing_happens_ends_it_too(robot) -> None:
    with running(robot) as process:
        assert process.stderr.readline().startswith("linked to ")
        process.stdout.close()
        assert process.wait(WAIT_S) == 0


def test_a_full_disk_is_one_clear_error(working) -> None:
    with Path("/dev/full").open("w") as full, running(working, stdout=full) as process:
        assert process.wait(WAIT_S) == 2
        told = process.stderr.read()
    assert told.splitlines()[-1] == "error: cannot write what was received: No space left on device"


MANY = 120_000
"""More messages than fit into the pipe and the tap's memory."""


def test_a_reader_that_is_slow_is_told_how_many_it_missed(robot) -> None:
    with running(robot, "/adder/count", "--json") as process:
        assert process.stderr.readline().startswith("linked to ")
        for number in range(MANY):  # nobody reads meanwhile, and publishing goes on
            robot.count.publish(Number(number))
        heard = []
        later, asked = MANY, False
        for text in process.stdout:  # to its end: a gap between the last ones is told, too
            heard.append(json.loads(text)["data"]["data"])
            if heard[-1] >= MANY and not asked:
                process.send_signal(signal.SIGINT)
                asked = True
            elif not asked and len(heard) % 1000 == 0:  # as it is read there is room again
                robot.count.publish(Number(later))
                later += 1
        told = process.stderr.read()
        process.wait(WAIT_S)
    missed = heard[-1] + 1 - heard[0] - len(heard)
    assert missed > 0
    assert heard == sorted(set(heard))
    assert f"warning: missed {missed} messages on /adder/count from adder" in told.splitlines()


def test_a_reader_that_is_stuck_does_not_keep_it_from_ending(robot) -> None:
    with running(robot, "/adder/count", "--json") as process:
        assert process.stderr.readline().startswith("linked to ")
        for number in range(MANY):
            robot.count.publish(Number(number))
        while process.poll() is None:  # the first asks, the second insists
            process.send_signal(signal.SIGINT)
            with suppress(subprocess.TimeoutExpired):
                process.wait(0.2)
        assert process.returncode in (0, -signal.SIGINT)


def test_what_is_not_selected_by_channel_is_not_even_heard(working) -> None:
    result = run(working, "/adder/count", "--for", "1")
    words = result.stderr.splitlines()[-1].replace(",", "").split()
    assert words[0] == "received"
    assert int(words[1]) == int(words[words.index("showed") + 1]) > 0


def test_it_says_to_whom_it_is_linked(robot) -> None:
    with running(robot) as process:
        for told in process.stderr:
            if told.strip() == "linked to 2 nodes: adder, caller":
                break
        else:
            pytest.fail("it did not say so")


def test_it_says_that_it_is_linked_to_nobody(hub) -> None:
    with running(hub) as process:
        assert process.stderr.readline().startswith("not linked to any node yet: ")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--count", "0"], "Invalid value for '--count': 0 is not in the range x>=1."),
        (["--count", "-1"], "Invalid value for '--count': -1 is not in the range x>=1."),
        (["--for", "0"], "Invalid value for '--for': 0.0 is not in the range x>0."),
        (["--for", "-2"], "Invalid value for '--for': -2.0 is not in the range x>0."),
        (["--for", "nan"], "Invalid value for '--for': 'nan' is no finite number"),
        (["--for", "inf"], "Invalid value for '--for': 'inf' is no finite number"),
        (
            ["level"],
            "Invalid value for CHANNELS: 'level' matches no channel: "
            "a channel starts with '/'; write '/level'",
        ),
        (
            ["--kind", "topic"],
            "Invalid value for '--kind': 'topic' is not one of "
            "'message', 'request', 'response', 'unanswered', 'taken', 'action'.",
        ),
        (["--zenoh-config", "/no/such.json5"], "File '/no/such.json5' does not exist."),
        (
            ["--endpoint", "localhost"],
            "endpoint 'localhost' is not an endpoint; "
            "write <protocol>/<address>, e.g. tcp/127.0.0.1:7447",
        ),
        (["--namespace", "a//b"], "namespace 'a//b': Invalid Key Expr"),
        (["--transport", "telepathy"], "no transport `telepathy` is installed; installed: "),
        (["--transport", "simulated"], "--transport simulated: that world is in one process"),
    ],
)
def test_a_bad_option_is_one_clear_error_and_exit_code_2(arguments, message) -> None:
    result = subprocess.run(
        [*MOON, "tap", *arguments], capture_output=True, text=True, timeout=WAIT_S, check=False
    )
    assert result.returncode == 2
    assert message in " ".join(result.stderr.split())
    assert "Traceback" not in result.stderr


def test_an_endpoint_where_nobody_listens_is_exit_code_2() -> None:
    with socket.socket() as silent:  # bound, and does not listen: nobody else can
        silent.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{silent.getsockname()[1]}"
        result = subprocess.run(
            [*MOON, "tap", "--endpoint", endpoint],
            capture_output=True,
            text=True,
            timeout=WAIT_S,
            check=False,
        )
    assert result.returncode == 2
    assert result.stderr.startswith(f"error: cannot reach {endpoint} within 5 s")


def test_help_imports_neither_zenoh_nor_rich() -> None:
    script = (
        "import sys\n"
        "from click.testing import CliRunner\n"
        "from moon.cli import main\n"
        "result = CliRunner().invoke(main, ['tap', '--help'])\n"
        "assert result.exit_code == 0 and '--stats' in result.output\n"
        "assert not {'zenoh', 'rich', 'msgspec'} & set(sys.modules)\n"
    )
    subprocess.run([sys.executable, "-c", script], check=True, timeout=WAIT_S)
