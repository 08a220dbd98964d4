"""Nodes written by hand: those of docs/hand-written-nodes.md, on every transport, beside generated ones."""

from __future__ import annotations

import contextlib
import importlib.util
import os
import re
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from m2c.cli import main
from tests.codegen.quality import typed
from tests.transports.ros2_network import own_domain
from transports import SimulatedWorld
from transports.registry import connect

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "hand-written-nodes.md").read_text(encoding="utf-8")
NODES = dict(
    zip(
        re.findall(r"^`(\w+\.py)`", PAGE, re.MULTILINE),
        re.findall(r"^```python\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL),
        strict=True,
    )
)
SERVICE = "geometry_msgs/Point goal\n---\ngeometry_msgs/Point[] path\n"


def m2c(*arguments: object, code: int = 0) -> str:
    done = CliRunner().invoke(main, list(map(str, arguments)))
    assert done.exit_code == code, done.output
    return done.output


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The files of the page, made as it says."""
    service = tmp_path / "interfaces/rover_interfaces/srv/PlanPath.srv"
    service.parent.mkdir(parents=True)
    service.write_text(SERVICE)
    for name, text in NODES.items():
        (tmp_path / name).write_text(text)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    assert SERVICE in PAGE
    (command, said), *_ = re.findall(r"^\$ m2c (interfaces .*)\n(.*)$", PAGE, re.MULTILINE)
    assert m2c(*command.split()) == f"{said}\n"
    yield tmp_path
    for name in ("messages", "worker", *(file.removesuffix(".py") for file in NODES)):
        sys.modules.pop(name, None)


def classes(*names: str) -> list[Any]:
    return [importlib.import_module(name).NODE_CLASS for name in names]


def test_the_page_has_three_nodes() -> None:
    assert list(NODES) == ["lidar.py", "planner.py", "console.py"]


def test_the_nodes_of_the_page_are_well_typed(folder: Path) -> None:
    typed(folder, [*NODES, "messages.py"], [ROOT])


def test_they_talk_in_a_simulated_world_and_a_tap_sees_them(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lidar_class, planner_class, console_class = classes("lidar", "planner", "console")
    world = SimulatedWorld(seed=1)
    seen: list[tuple[str, str]] = []
    tap = world.connect("tap").tap([], lambda o: seen.append((o.channel, str(o.kind))))
    planner, console = (
        planner_class(world.connect("Planner")),
        console_class(world.connect("Console")),
    )
    lidar = lidar_class(world.connect("Lidar"))
    console.post(lambda: console.go(4.0, 2.0))  # before the first scan: refused
    world.run_for(1.05)
    assert capsys.readouterr().out == ""
    assert 0.1 <= planner.free < 10.0
    console.go(4.0, 2.0)
    world.run_for(0.5)
    assert capsys.readouterr().out == "(0, 0) (2, 1) (4, 2)\n"
    assert sum(kind == "message" and channel == "/scan" for channel, kind in seen) >= 10
    assert ("/plan", "response_received") in seen
    tap.close()
    assert (lidar.name, planner.name) == ("Lidar", "Planner")


def test_an_unanswered_call_is_logged_or_handed_over(
    folder: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (console_class,) = classes("console")
    messages = importlib.import_module("messages")
    world = SimulatedWorld(seed=1)
    console = console_class(world.connect("Console"))
    console.go(1.0, 1.0)
    world.run_for(10.0)
    assert [record.levelname for record in caplog.records] == ["WARNING"]
    assert "/plan" in caplog.text
    failed: list[Any] = []
    console.planner.call(messages.PlanPath.Request(), console.show, failed.append, timeout_s=0.5)
    world.run_for(10.0)
    assert len(failed) == 1
    assert len(caplog.records) == 1


@pytest.mark.parametrize(
    "transport",
    [pytest.param("zenoh", marks=pytest.mark.zenoh)],
)
def test_they_are_processes_that_talk(folder: Path, transport: str) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        endpoint = f"tcp/127.0.0.1:{server.getsockname()[1]}"
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    options = ["--transport", transport, "--endpoint", endpoint]
    with (
        contextlib.ExitStack() as ended,
        connect(transport, "test", {"rendezvous": endpoint}) as own,
    ):
        for name in ("lidar.py", "planner.py"):
            node = subprocess.Popen([sys.executable, name, *options], env=environment)
            ended.callback(node.wait)
            ended.callback(node.terminate)
        assert not own.wait_for_nodes(["Lidar", "Planner"], 30.0)
        console = subprocess.Popen(
            [sys.executable, "console.py", *options],
            env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
        ended.callback(console.wait)
        ended.callback(console.terminate)
        assert console.stdin is not None
        assert console.stdout is not None
        assert not own.wait_for_nodes(["Console"], 30.0)
        scanned = own.completion()
        own.tap(["/scan"], scanned.set)
        own.spin(lambda: scanned.wait(0) is not None)
        console.stdin.write("4 2\n")
        console.stdin.flush()
        assert console.stdout.readline() == "(0, 0) (2, 1) (4, 2)\n"


WORKER = """
import m2c
from messages import Int32, Start, StartRequest, StartResponse


class Worker(m2c.Node):
    def setup(self) -> None:
        self.left = 0
        self.progress = self.create_publisher(Int32, "/Worker/progress")
        self.create_service(Start, "/Worker/start", self.begin)
        self.create_timer(0.1, self.work)

    def begin(self, call: m2c.Call[StartRequest, StartResponse]) -> StartResponse:
        accepted = self.left == 0
        if accepted:
            self.left = call.data.steps
        return Start.Response(accepted=accepted)

    def work(self) -> None:
        if self.left > 0:
            self.left -= 1
            self.progress.publish(Int32(data=self.left + {offset}))


NODE_CLASS = Worker
if __name__ == "__main__":
    m2c.run_node(NODE_CLASS)
"""


def loaded(file: Path) -> dict[str, Any]:
    """What is in a module of messages."""
    spec = importlib.util.spec_from_file_location("of_test_hand_written", file)
    assert spec is not None
    assert spec.loader is not None
    module = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return vars(module)


@pytest.fixture
def system(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """What `m2c new` makes, and the classes of its messages."""
    monkeypatch.chdir(tmp_path)
    m2c("new", "demo")
    made = tmp_path / "demo"
    monkeypatch.chdir(made)
    m2c("interfaces", "python", "interfaces", "--type", "std_msgs/Int32")
    yield made
    for name in ("messages", "worker"):
        sys.modules.pop(name, None)


def as_file(system: Path, offset: int) -> Path:
    (system / "worker.py").write_text(WORKER.replace("{offset}", str(offset)))
    return system / "worker.py"


def as_package(system: Path, offset: int) -> Path:
    package = system / "own" / "worker"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text("")
    (package / "__main__.py").write_text(WORKER.replace("{offset}", str(offset)))
    return system / "own"


def run(system: Path, *options: object) -> tuple[int, str]:
    done = subprocess.run(
        [sys.executable, "-m", "m2c.cli", "run", *map(str, options)],
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), str(system)])},
        cwd=system, capture_output=True, text=True, check=False,
    )  # fmt: skip
    return done.returncode, done.stdout + done.stderr


@pytest.mark.parametrize("made", [as_file, as_package])
@pytest.mark.parametrize(("offset", "code"), [(0, 0), (5, 1)])
def test_one_in_the_place_of_a_model_is_judged_by_it_in_virtual_time(
    system: Path, made: Any, offset: int, code: int
) -> None:
    node = made(system, offset)
    options = [
        "--transport",
        "simulated",
        "--ticks",
        "20",
        "--monitor",
        "--replace",
        f"Worker={node}",
    ]
    ended, said = run(system, *options)
    assert ended == code, said
    assert ("VIOLATED" in said) == bool(code)
    assert "Traceback" not in said


@pytest.mark.zenoh
@pytest.mark.parametrize("processes", ["each", "1"])
@pytest.mark.parametrize("made", [as_file, as_package])
def test_one_in_the_place_of_a_model_runs_with_the_others(
    system: Path, made: Any, processes: str
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        endpoint = f"tcp/127.0.0.1:{server.getsockname()[1]}"
    options = ["--endpoint", endpoint, "--processes", processes, "--ticks", "8"]
    ended, said = run(system, *options, "--replace", f"Worker={made(system, 0)}")
    assert ended == 0, said
    assert "Work ok" in said


@pytest.mark.parametrize("transport", ["simulated", "zenoh"])
def test_a_file_without_a_node_is_refused(system: Path, transport: str) -> None:
    (system / "worker.py").write_text("print('no NODE_CLASS')\n")
    options = ["--transport", transport, "--replace", "Worker=worker.py", "--ticks", "2"]
    ended, said = run(system, *options, *(["--processes", "1"] if transport == "zenoh" else []))
    assert ended
    assert "worker.py: it has no NODE_CLASS; end it with NODE_CLASS = …" in said
    assert "Traceback" not in said


@pytest.mark.parametrize(
    ("right", "wrong", "said"),
    [
        ("(Int32, ", '("Int32", ', "/Worker/progress: 'Int32' is not the class of a message"),
        ("(Int32, ", "(Start, ", "/Worker/progress: demo_interfaces/srv/Start is not the class of a message"),
        ("(Start, ", "(Int32, ", "/Worker/start: std_msgs/msg/Int32 is not the type of a service"),
        ("setup(self)", "__init__(self)", "Worker.__init__ is given a connection and settings; declare channels in `def setup(self)` instead"),
        ("m2c.Node", "m2c.Nod", "module 'm2c' has no attribute 'Nod'"),
        ("(self) -> None", "(self -> None", "SyntaxError: "),
        ("(0.1, ", "('1', ", "worker.py, line 11: self.create_timer('1', self.work)"),
    ],
)  # fmt: skip
def test_a_mistake_is_told_in_a_line_with_its_place(
    system: Path, right: str, wrong: str, said: str
) -> None:
    written = WORKER.replace("{offset}", "0")
    (system / "worker.py").write_text(written.replace(right, wrong, 1))
    ended, output = run(
        system, "--transport", "simulated", "--replace", "Worker=worker.py", "--ticks", "2"
    )
    assert ended
    assert said in output.splitlines()[-1]
    assert "worker.py, line" in output.splitlines()[-1]
    assert "Traceback" not in output


@pytest.mark.parametrize(
    ("written", "said"),
    [
        ("/Worker/progres", "WARNING Worker: no model names /Worker/progres; did you mean /Worker/progress?"),
        ("/worker/progress", "WARNING Worker: no model names /worker/progress; did you mean /Worker/progress?"),
        ("/camera/image", ""),
    ],
)  # fmt: skip
@pytest.mark.parametrize(
    "transport",
    ["simulated", pytest.param("zenoh", marks=pytest.mark.zenoh)],
)
@pytest.mark.parametrize("made", [as_file, as_package])
def test_a_channel_that_is_misspelt_is_told(
    system: Path, made: Any, transport: str, written: str, said: str
) -> None:
    node = made(system, 0)
    file = next(node.rglob("__main__.py"), node) if node.is_dir() else node
    file.write_text(file.read_text().replace('"/Worker/progress"', f'"{written}"'))
    options = ["--transport", transport, "--replace", f"Worker={node}", "--ticks", "2"]
    if transport == "zenoh":
        with socket.create_server(("127.0.0.1", 0)) as server:
            options += ["--endpoint", f"tcp/127.0.0.1:{server.getsockname()[1]}"]
    _, output = run(system, *options)
    assert output.count(said or "/camera") == bool(said)
    assert ("no model names" in output) == bool(said)


ZENOH = pytest.param("zenoh", marks=pytest.mark.zenoh)


def with_work(system: Path, work: str, transport: str) -> list[str]:
    """The options of a run of a Worker whose timer's handler begins with ``work``."""
    text = WORKER.replace("{offset}", "0").replace(
        "work(self) -> None:", f"work(self) -> None:\n{work}"
    )
    (system / "worker.py").write_text("import json, threading, time\n" + text)
    options = ["--transport", transport, "--replace", "Worker=worker.py", "--ticks", "3"]
    if transport == "zenoh":
        with socket.create_server(("127.0.0.1", 0)) as server:
            options += ["--endpoint", f"tcp/127.0.0.1:{server.getsockname()[1]}"]
    return options


@pytest.mark.parametrize("transport", [ZENOH])
@pytest.mark.parametrize(
    "work",
    [
        "        self.left / 0",
        "        json.loads('{')",
        "        try:\n            self.left / 0\n        except ZeroDivisionError as error:\n            raise ValueError from error",
    ],
)  # fmt: skip
def test_what_a_handler_raises_is_told_by_lines_of_its_author(
    system: Path, transport: str, work: str
) -> None:
    ended, output = run(system, *with_work(system, work, transport))
    assert ended == 1
    told = [line for line in output.splitlines() if "File " in line]
    assert any("worker.py" in line for line in told)
    assert not any(f"{ROOT}/{part}/" in line for line in told for part in ("m2c", "transports"))
    assert "CRITICAL Worker: it died" in output
    assert "Worker exited with code 1; everything was stopped" in output


@pytest.mark.zenoh
@pytest.mark.parametrize("work", ["        self.left / 0", "        self.publisher"])
def test_one_that_is_started_by_itself_is_told_so_too(system: Path, work: str) -> None:
    with_work(system, work, "zenoh")
    done = subprocess.run(
        [sys.executable, "worker.py"],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        cwd=system, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 1
    assert done.stderr.startswith("CRITICAL Worker: it died\n  Traceback")
    assert all("worker.py" in line for line in done.stderr.splitlines() if "File " in line)


@pytest.mark.parametrize(
    ("file", "said"),
    [
        ("no.json", "no.json: No such file or directory"),
        ("worker.py", "expected the launch.json that `m2c generate` writes"),
    ],
)
def test_channels_that_cannot_be_read_are_refused(system: Path, file: str, said: str) -> None:
    with_work(system, "        pass", "simulated")
    done = subprocess.run(
        [sys.executable, "worker.py", "--channels", file],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        cwd=system, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 2
    assert done.stderr.startswith("usage: python worker.py ")
    assert done.stderr.splitlines()[-1].startswith("python worker.py: error: argument --channels: ")
    assert done.stderr.splitlines()[-1].endswith(said)


@pytest.mark.parametrize("transport", ["simulated", ZENOH])
@pytest.mark.parametrize("work", ["time.sleep(1.5)", "threading.Event().wait(1.5)"])
def test_a_handler_that_takes_its_time_is_told_once_with_its_line(
    system: Path, transport: str, work: str
) -> None:
    first = (
        f"        if not hasattr(self, 'slow'):\n            self.slow = True\n            {work}"
    )
    _, output = run(system, *with_work(system, first, transport))
    (told,) = [line for line in output.splitlines() if "has run for" in line]
    assert "WARNING Worker: Worker.work has run for " in told
    assert told.endswith(f"; it is in worker.py, line 23: {work}")


def test_a_file_that_cannot_be_a_module_is_refused(system: Path) -> None:
    (system / "my-worker.py").write_text(WORKER.replace("{offset}", "0"))
    ended, said = run(system, "--transport", "simulated", "--replace", "Worker=my-worker.py")
    assert ended == 2
    assert "my-worker.py: not a name of a Python module" in said


@pytest.mark.parametrize(
    ("wanted", "said"),
    [
        ("nonsense", "unknown type nonsense; known: "),
        ("sensor_msg", "unknown type sensor_msg; did you mean sensor_msgs?"),
        ("sensor_msgs/LaserScann", "did you mean sensor_msgs/msg/LaserScan?"),
        ("std_srvs/srv/SetBol", "did you mean std_srvs/srv/SetBool?"),
        ("", "unknown type "),
        ("a/b/c/d", "unknown type a/b/c/d"),
        ("../../etc", "unknown type ../../etc"),
    ],
)
def test_a_type_that_is_not_known_is_refused_with_the_nearest(
    tmp_path: Path, wanted: str, said: str
) -> None:
    output = tmp_path / "messages.py"
    assert said in m2c("interfaces", "python", "--type", wanted, "-o", output, code=2)
    assert not output.exists()


@pytest.mark.parametrize(
    "definition",
    [
        "float32 x y z\n",
        "no_such/Type x\n",
        "int32[99999999999 x\n",
        "loop/A x\n",
        "int32 class\nint32 x\n",
    ],
)
def test_a_definition_with_a_fault_is_refused_or_right(tmp_path: Path, definition: str) -> None:
    file = tmp_path / "interfaces/loop/msg/A.msg"
    file.parent.mkdir(parents=True)
    file.write_text(definition)
    output = tmp_path / "messages.py"
    done = CliRunner().invoke(
        main, ["interfaces", "python", str(tmp_path / "interfaces"), "-o", str(output)]
    )
    if "class" in definition:
        assert done.exit_code == 0
        compile(output.read_text(), "messages.py", "exec")
    else:
        assert done.exit_code == 2, done.output
        assert "A.msg" in done.output or "no_such" in done.output
        assert not output.exists()


def test_types_that_are_called_alike_are_told_apart(tmp_path: Path) -> None:
    for package, text in (("one_msgs", "int32 a\n"), ("two_msgs", "string b\n")):
        file = tmp_path / f"interfaces/{package}/msg/Thing.msg"
        file.parent.mkdir(parents=True)
        file.write_text(text)
    output = tmp_path / "messages.py"
    m2c("interfaces", "python", tmp_path / "interfaces", "--type", "std_srvs", "-o", output)
    module = loaded(output)
    assert module["Thing"].__type_name__ == "one_msgs/msg/Thing"
    assert module["TwoMsgsThing"].__type_name__ == "two_msgs/msg/Thing"
    assert module["SetBool"].Request.__type_name__ == "std_srvs/srv/SetBool_Request"


def test_all_standard_types_fit_into_one_module(tmp_path: Path) -> None:
    from m2c.model.standard import standard_texts

    packages = sorted({name.partition("/")[0] for name in standard_texts()})
    output = tmp_path / "messages.py"
    m2c("interfaces", "python", *(word for p in packages for word in ("--type", p)), "-o", output)
    module = loaded(output)
    found = {
        getattr(value, "__type_name__", getattr(value, "type_name", ""))
        for value in module.values()
    }
    assert set(standard_texts()) <= found


@pytest.mark.ros2
def test_they_talk_on_ros_2(tmp_path: Path) -> None:
    from m2c import Node

    output = tmp_path / "messages.py"
    m2c("interfaces", "python", "--type", "std_msgs/Int32", "--type", "std_srvs", "-o", output)
    messages = loaded(output)
    heard: list[Any] = []

    class Switch(Node):
        def setup(self) -> None:
            self.counts = self.create_publisher(messages["Int32"], "/count", transient_local=True)
            self.create_service(messages["SetBool"], "/switch", self.switch)

        def switch(self, call: Any) -> Any:
            self.counts.publish(messages["Int32"](data=7))
            return messages["SetBool"].Response(success=call.data.data, message=call.client)

    class User(Node):
        def setup(self) -> None:
            self.create_subscription(
                messages["Int32"], "/count", heard.append, transient_local=True
            )
            self.switch = self.create_client(messages["SetBool"], "/switch")

    with (
        own_domain(),
        connect("ros2", "Switch", {}) as first,
        connect("ros2", "User", {}) as second,
    ):
        switch, user = Switch(first), User(second)
        first.announce()
        assert not second.wait_for_nodes(["Switch"], 30.0)
        spinning = threading.Thread(target=first.spin)
        spinning.start()
        user.post(
            lambda: user.switch.call(
                messages["SetBool"].Request(data=True), heard.append, timeout_s=20
            )
        )
        second.after(30.0, second.close)
        second.spin(lambda: len(heard) == 2)
        first.post(first.close)
        spinning.join()
    assert switch.name == "Switch"
    assert {type(message).__name__ for message in heard} == {"Int32", "SetBoolResponse"}
    assert any(getattr(message, "success", False) for message in heard)
