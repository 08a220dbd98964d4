"""How commands end when what they stand on goes away: the terminal, the disk, files that may be open."""

from __future__ import annotations

import os
import pty
import select
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from moon.recording.entries import Ended
from moon.recording.reader import open_recording
from tests.commands.on_terminal import BIN, WAIT_S
from tests.launch.system import System
from tests.monitor.processes import free_endpoint
from tests.recordings.make import HERE as GOLDEN
from transports.zenoh import connect

pytestmark = pytest.mark.slow

EXAMPLE = Path(__file__).parents[2] / "examples" / "lab_tour"
SYSTEM = EXAMPLE / "system.xml"
RUN = GOLDEN / "zenoh-nominal.mcap"

LONG_SETTLING = ["monitor", SYSTEM, "--latency-bound", 1]
"""Two seconds for what may still come, and a look at the terminal every half of one."""

_LOG_IN = (
    "import fcntl, os, sys, termios\n"
    "os.setsid()\n"
    "fcntl.ioctl(0, termios.TIOCSCTTY, 0)\n"
    "os.execv(sys.argv[1], sys.argv[1:])\n"
)
"""A process that has a terminal as an ssh session has one: who leads it is told when it is gone."""


class Session:
    """A command of ours in a session of its own, whose terminal can go away."""

    def __init__(self, *command: object) -> None:
        self._ours, theirs = pty.openpty()
        program = [str(BIN / str(command[0])), *map(str, command[1:])]
        self.process = subprocess.Popen(
            [sys.executable, "-c", _LOG_IN, *program], stdin=theirs, stdout=theirs, stderr=theirs
        )
        os.close(theirs)
        self.text = ""

    def until(self, holds: Callable[[str], object]) -> None:
        """Read what is shown until it is so."""
        deadline = time.monotonic() + WAIT_S
        while not holds(self.text):
            ready, _, _ = select.select([self._ours], [], [], max(deadline - time.monotonic(), 0))
            assert ready, self.text
            self.text += os.read(self._ours, 65536).decode(errors="replace")

    def hang_up(self) -> int:
        """The terminal is gone; the exit code."""
        os.close(self._ours)
        return self.process.wait(WAIT_S)


@contextmanager
def somebody() -> Iterator[str]:
    """A node to connect to, at an endpoint."""
    endpoint = free_endpoint()
    node = connect("Somebody", {"listen": endpoint})
    thread = threading.Thread(target=node.spin)
    thread.start()
    node.announce()
    try:
        yield endpoint
    finally:
        node.post(node.close)
        thread.join(WAIT_S)


def until_caught(pid: int, number: signal.Signals) -> None:
    """Wait until the process has something of its own to do at a signal (proc(5))."""
    deadline = time.monotonic() + WAIT_S
    while True:
        status = Path(f"/proc/{pid}/status").read_text()
        if int(status.partition("SigCgt:")[2].split()[0], 16) >> number - 1 & 1:
            return
        assert time.monotonic() < deadline, status
        time.sleep(0.01)


# --- the terminal is gone --------------------------------------------------------------------------


@pytest.mark.zenoh
def test_a_run_whose_terminal_is_gone_halts_its_tree_and_leaves_nobody(tmp_path: Path) -> None:
    system = System(tmp_path / "lab")
    trace = tmp_path / "trace.mcap"
    endpoint = free_endpoint()
    run = Session("m2c", "run", system.path, "--endpoint", endpoint, "--processes", "each")
    run.until(lambda text: "nodes are up" in text)
    recorder = subprocess.Popen(
        [BIN / "moon", "record", "-o", trace, "--endpoint", endpoint],
        stderr=subprocess.PIPE,
        text=True,
    )
    assert recorder.stderr is not None
    assert any("judged in any case" in line for line in iter(recorder.stderr.readline, ""))
    seen = len(run.text)
    run.until(lambda text: "RUNNING" in text[seen:])
    children = Path(f"/proc/{run.process.pid}/task/{run.process.pid}/children").read_text().split()
    assert len(children) == 3
    assert run.hang_up() == 0
    assert not [pid for pid in children if Path(f"/proc/{pid}").exists()]
    recorder.send_signal(signal.SIGHUP)
    _, said = recorder.communicate(timeout=WAIT_S)
    assert recorder.returncode == 0, said
    entries = list(open_recording(trace).entries())
    assert [e for e in entries if getattr(e, "channel", "") == "/MoveSkill/halt"], entries


@pytest.mark.zenoh
@pytest.mark.parametrize(
    "arguments",
    [["record", "-o"], ["monitor", SYSTEM, "--record"], [*LONG_SETTLING, "--record"]],
    ids=["record", "monitor", "monitor that looks around before it ends"],
)
def test_a_recording_is_ended_in_good_order_when_the_terminal_is_gone(
    arguments: list[object], tmp_path: Path
) -> None:
    path = tmp_path / "run.mcap"
    with somebody() as endpoint:
        session = Session("moon", *arguments, path, "--endpoint", endpoint)
        session.until(lambda _: path.exists())
        session.until(lambda text: "observations (" in text or "unseen" in text)
        assert session.hang_up() == 0
    recording = open_recording(path)
    *_, last = recording.entries()
    assert isinstance(last, Ended)
    assert recording.faults() == []


@pytest.mark.zenoh
def test_a_recording_is_ended_in_good_order_when_nobody_reads_what_is_shown(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with somebody() as endpoint:
        monitor = subprocess.Popen(
            [BIN / "moon", "monitor", SYSTEM, "--record", path, "--endpoint", endpoint],
            stdout=subprocess.PIPE,
        )
        assert monitor.stdout is not None
        monitor.stdout.close()
        assert monitor.wait(WAIT_S) == 0
    recording = open_recording(path)
    *_, last = recording.entries()
    assert isinstance(last, Ended)
    assert recording.faults() == []


@pytest.mark.zenoh
@pytest.mark.parametrize(
    "arguments",
    [
        ["tap"],
        ["monitor", SYSTEM],
        ["replay", RUN, "--interfaces", EXAMPLE / "interfaces", "--stay"],
    ],
    ids=["tap", "monitor", "replay"],
)
def test_a_lost_session_ends_a_command_as_kill_does(arguments: list[object]) -> None:
    with somebody() as endpoint:
        command = subprocess.Popen(
            [BIN / "moon", *map(str, arguments), "--endpoint", endpoint],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        )
        until_caught(command.pid, signal.SIGHUP)
        command.send_signal(signal.SIGHUP)
        _, said = command.communicate(timeout=WAIT_S)
    assert command.returncode == 0, said
    assert "Traceback" not in said


def test_who_was_started_to_outlive_its_session_goes_on() -> None:
    code = (
        "import signal\n"
        "from transports.stop_signals import StopSignals\n"
        "signals = StopSignals()\n"
        "signal.raise_signal(signal.SIGHUP)\n"
        "print(signals.asked)\n"
    )
    for before, asked in (("", "True"), ("trap '' HUP; ", "False")):
        done = subprocess.run(
            ["sh", "-c", f'{before}exec "{sys.executable}" -c "$0"', code],
            stdout=subprocess.PIPE,
            text=True,
            check=True,
            timeout=WAIT_S,
        )
        assert done.stdout.strip() == asked


TOLD_WHILE_IT_CONNECTS = """
import os, signal, sys
from transports import registry

connect = registry.connect

def told(*arguments):
    connection = connect(*arguments)
    try:
        os.kill(os.getpid(), signal.SIGINT)
        for _ in range(1000):
            pass
    except KeyboardInterrupt:  # as some function of a library in C or Rust takes it
        pass
    return connection

registry.connect = told
from moon.cli import main
main()
"""


def test_a_signal_that_comes_while_a_command_connects_is_not_lost() -> None:
    command = ("tap", "--endpoint", free_endpoint())
    done = subprocess.run(
        [sys.executable, "-c", TOLD_WHILE_IT_CONNECTS, *command],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        check=False,
        timeout=WAIT_S,
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr.splitlines()[-1].startswith("received 0 observations"), done.stderr


# --- the disk is full ------------------------------------------------------------------------------

FULL = "No space left on device"


def ended(
    *command: object, env: dict[str, str] | None = None, **streams: object
) -> tuple[int, str]:
    """Exit code and standard error of a command."""
    done = subprocess.run(
        [BIN / str(command[0]), *map(str, command[1:])],
        **{"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE, **streams},
        env={**os.environ, **(env or {})},
        text=True,
        check=False,
        timeout=WAIT_S,
    )
    return done.returncode, done.stderr


@pytest.mark.parametrize(
    "command",
    [
        ("m2c", "--help"),
        ("m2c", "check", SYSTEM),
        ("m2c", "generate", SYSTEM, "-o", "OUT"),
        ("moon", "check", RUN, SYSTEM, "--json"),
        ("moon", "check", GOLDEN / "zenoh-T1.mcap", SYSTEM),
        ("moon", "explain", SYSTEM),
        ("moon", "check-properties", EXAMPLE / "properties.yaml"),
    ],
)
def test_a_full_output_is_one_line_and_no_verdict(
    command: tuple[object, ...], tmp_path: Path
) -> None:
    words = [tmp_path / "out" if word == "OUT" else word for word in command]
    with Path("/dev/full").open("w") as full:
        code, said = ended(*words, stdout=full)
    assert code == 2
    assert said.count("\n") == 1, said
    assert FULL in said


@pytest.mark.zenoh
def test_a_run_that_can_show_nothing_ends_in_good_order_and_says_so(tmp_path: Path) -> None:
    system = System(tmp_path / "lab")
    with Path("/dev/full").open("w") as full:
        code, said = ended("m2c", "run", system.path, "--endpoint", free_endpoint(), stdout=full)
    assert (code, said) == (2, f"error: standard output: {FULL}\n")


@pytest.mark.parametrize(
    "command", [("m2c", "check", SYSTEM), ("moon", "check", RUN, SYSTEM), ("m2c", "--help")]
)
def test_who_cannot_be_told_of_what_goes_on_beside_is_given_the_exit_code(
    command: tuple[object, ...],
) -> None:
    with Path("/dev/full").open("w") as full:
        assert ended(*command, stderr=full) == (0, None)


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A folder with room for 64 kB."""
    folder = tmp_path / "small"
    folder.mkdir()
    made = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=64k", "tmpfs", folder],
        capture_output=True,
        check=False,
    )
    if made.returncode:
        pytest.skip("only root can make a small disk")
    yield folder
    subprocess.run(["umount", folder], check=True)


def test_what_is_generated_onto_a_full_disk_is_no_edit_when_there_is_room_again(
    small_disk: Path,
) -> None:
    out = small_disk / "generated"
    code, said = ended("m2c", "generate", SYSTEM, "-o", out)
    assert code == 2
    assert said.startswith(f"error: cannot write {out}/")
    assert said.endswith(f": {FULL}\n")
    subprocess.run(["mount", "-o", "remount,size=8m", small_disk], check=True)
    assert ended("m2c", "generate", SYSTEM, "-o", out) == (0, "")


@pytest.mark.parametrize("option", ["--report", "--junit", "--log"])
def test_a_file_that_cannot_be_written_is_named(small_disk: Path, option: str) -> None:
    (small_disk / "filler").write_bytes(bytes(64 * 1024))
    path = small_disk / "result.html"
    code, said = ended("moon", "check", GOLDEN / "zenoh-T1.mcap", SYSTEM, option, path)
    assert (code, said) == (2, f"error: cannot write {path}: {FULL}\n")


@pytest.mark.zenoh
def test_a_full_disk_ends_a_recording_in_one_line(small_disk: Path) -> None:
    path = small_disk / "run.mcap"
    (small_disk / "filler").write_bytes(bytes(64 * 1024))
    with somebody() as endpoint:
        code, said = ended("moon", "record", "-o", path, "--endpoint", endpoint, "--for", 1)
    assert (code, said) == (2, f"error: cannot write the recording: {FULL}\n")


# --- other things that run out ---------------------------------------------------------------------


def test_no_temporary_folder_is_one_line(tmp_path: Path) -> None:
    """Where no folder can be written in, which root can only be kept from by a name that is none."""
    code = "import sys, tempfile; tempfile._candidate_tempdir_list = lambda: ['/proc/nowhere']; "
    for module, arguments in (
        ("m2c.cli", ["run", str(SYSTEM)]),
        ("m2c.cli", ["generate", str(SYSTEM), "-o", str(tmp_path / "out")]),
    ):
        done = subprocess.run(
            [sys.executable, "-c", f"{code}from {module} import main; main({arguments!r})"],
            capture_output=True,
            text=True,
            check=False,
            timeout=WAIT_S,
        )
        assert done.returncode == 2, done.stderr
        assert done.stderr.count("\n") == 1, done.stderr
        assert "No usable temporary directory" in done.stderr


@pytest.mark.zenoh
@pytest.mark.parametrize(
    ("files", "command"),
    [
        (16, ("m2c", "run", SYSTEM, "--ticks", "1")),
        (64, ("m2c", "run", SYSTEM, "--ticks", "1")),
        (16, ("moon", "check", RUN, RUN, SYSTEM, "--jobs", "2")),
        (16, ("moon", "tap", "--for", "0.1")),
        (64, ("moon", "tap", "--for", "0.1")),
        (64, ("moon", "record", "-o", "OUT", "--for", "0.1")),
        (64, ("moon", "monitor", SYSTEM, "--for", "0.1")),
    ],
)
def test_where_few_files_may_be_open_a_command_works_or_says_why_not(
    command: tuple[object, ...], files: int, tmp_path: Path
) -> None:
    words = [str(tmp_path / "out.mcap" if word == "OUT" else word) for word in command]
    with somebody() as endpoint:
        if words[1] != "check":
            words += ["--endpoint", free_endpoint() if words[1] == "run" else endpoint]
        done = subprocess.run(
            ["sh", "-c", f'ulimit -n {files}; exec "$0" "$@"', str(BIN / words[0]), *words[1:]],
            capture_output=True,
            text=True,
            check=False,
            timeout=WAIT_S,
        )
    assert "Traceback" not in done.stderr
    assert done.returncode in (0, 2), done.stderr
    if done.returncode:
        assert done.stderr.splitlines()[-1].startswith("error: "), done.stderr
