"""Commands under a pseudo terminal, which is sent no text of others that it would obey."""

from __future__ import annotations

import json
import signal
import socket
import threading
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest
import zenoh

from tests.commands.on_terminal import HOSTILE, IN_XML, SHOWN, OnTerminal, require_harmless
from transports.interface import Service, Topic
from transports.zenoh import connect
from transports.zenoh.wire import attachment

pytestmark = pytest.mark.slow

NAME = HOSTILE.replace("/", "_")
"""Of a file."""
CHANNEL = "/c" + "".join(HOSTILE.split())

MODEL = f"""<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" name="N{IN_XML}" initial="s{IN_XML}">
<datamodel><data id="v{IN_XML}" expr="w{IN_XML}" type="t{IN_XML}"/></datamodel>
<ros_topic_publisher name="p{IN_XML}" topic="/c{IN_XML}" type="std_msgs/T{IN_XML}"/>
<ros_topic_subscriber name="q" topic="/c{IN_XML}" type="hostile/Message"/>
<state id="s{IN_XML}"><onentry><log label="l{IN_XML}" expr="x{IN_XML}"/></onentry>
<transition event="e{IN_XML}" target="t{IN_XML}"/><u{"n" * 5} a="{IN_XML}"/></state></scxml>"""

LEVEL = """<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" name="Level" initial="s">
<ros_topic_publisher name="level" topic="/level" type="std_msgs/Int32"/><state id="s"/></scxml>"""

PROPERTIES = {
    "ports": {"p": {"topic": "/level", "field": "data"}},
    "predicates": {"low": "p < 30"},
    "properties": [
        {
            "id": f"P{HOSTILE}",
            "text": f"text {HOSTILE}",
            "severity": "error",
            "formula": "historically(not {low})",
        },
        {"id": f"Q{HOSTILE}", "severity": HOSTILE, HOSTILE: HOSTILE},
    ],
}


class Data(msgspec.Struct):
    data: str = HOSTILE


Data.__type_name__ = "hostile/msg/Data"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with a hostile name: a model, its interface package and a property file."""
    made = tmp_path / f"models{NAME}"
    types = made / "interfaces" / "hostile" / "msg"
    types.mkdir(parents=True)
    (types / "Message.msg").write_text(f"int32 data\nno type{HOSTILE}\n{HOSTILE} x\n")
    (made / f"model{NAME}.scxml").write_text(MODEL)
    (made / "level.scxml").write_text(LEVEL)
    (made / f"properties{NAME}.yaml").write_text(json.dumps(PROPERTIES))
    return made


@pytest.mark.parametrize(
    ("command", "arguments"),
    [
        ("m2c", ("check", "{folder}")),
        ("m2c", ("check", "--format", "json", "{folder}")),
        ("m2c", ("check", "--format", "sarif", "{folder}")),
        ("m2c", ("draw", "{model}", "-o", "{folder}/x.svg")),
        ("m2c", ("draw", "{folder}/level.scxml", "-o", "{folder}/nowhere/x.svg")),
        ("m2c", ("generate", "{folder}", "-o", "{folder}/out")),
        ("m2c", ("run", "{model}")),
        ("m2c", ("run", "{folder}", "--only", HOSTILE)),
        pytest.param(
            *("m2c", ("interfaces", "build", "{folder}/interfaces", "-o", "{folder}")),
            marks=pytest.mark.ros2,
        ),
        ("moon", ("explain", "{folder}")),
        ("moon", ("explain", "{folder}/level.scxml", "--only", HOSTILE)),
        ("moon", ("check-properties", "{properties}")),
        ("moon", ("check-properties", "--json", "{properties}")),
        ("moon", ("monitor", "{folder}")),
        ("moon", ("check", "{folder}/nowhere.mcap", "{folder}")),
        ("moon", ("replay", "{folder}/nowhere.mcap")),
    ],
    ids=lambda value: value if isinstance(value, str) else " ".join(value[:2]),
)
def test_files_and_folders_are_named_and_shown_harmlessly(
    command: str, arguments: tuple[str, ...], folder: Path
) -> None:
    places = {
        "folder": folder,
        "model": next(folder.glob("model*")),
        "properties": next(folder.glob("prop*")),
    }
    run = OnTerminal(command, *(item.format(**places) for item in arguments))
    assert run.end() == 2, run.text
    require_harmless(run.text)
    shown = ("\\x1b]0;owned", "\\u001b]0;owned", "%1B%5D0%3Bowned")
    assert any(word in run.text for word in shown), run.text


def test_what_check_says_keeps_its_colours(folder: Path) -> None:
    run = OnTerminal("m2c", "check", next(folder.glob("model*")))
    run.end()
    assert "\x1b[31merror:\x1b[0m" in run.text or " \x1b[31merror:\x1b[0m" in run.text


def test_a_log_of_a_run_is_checked_and_explained_harmlessly(folder: Path, tmp_path: Path) -> None:
    (tmp_path / f"log{NAME}").mkdir()
    log = tmp_path / f"log{NAME}" / "run.jsonl"
    lines = [
        {"topic": "/level", "time": 1, "data": 5, HOSTILE: HOSTILE},
        {"service": f"/s{HOSTILE}", "time": 2, "request": {HOSTILE: HOSTILE}},
        {"topic": CHANNEL, "time": 3, "data": 50},
    ]
    log.write_text("".join(json.dumps(line) + "\n" for line in lines) + f"[{HOSTILE!r}]\n{HOSTILE}")
    only = {**PROPERTIES, "properties": PROPERTIES["properties"][:1]}  # type: ignore[index]
    properties = tmp_path / "properties.yaml"
    properties.write_text(json.dumps(only))
    check = OnTerminal("moon", "check", log, "--properties", properties)
    code = check.end()
    require_harmless(check.text)
    assert code == 1, check.text
    assert f"P{SHOWN}" in check.text
    explain = OnTerminal("moon", "explain", folder / "level.scxml", "--recording", log)
    explain.end()
    require_harmless(explain.text)
    assert SHOWN in explain.text


# --- what comes from the wire ----------------------------------------------------------------------


class Publisher:
    """A node with a hostile name, that publishes, serves and calls under hostile names, and raw bytes."""

    def __init__(self) -> None:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.endpoint = f"tcp/127.0.0.1:{free.getsockname()[1]}"
        self.node = connect(f"node{NAME}", {"listen": self.endpoint})
        topic = Topic(CHANNEL, f"hostile/msg/D{HOSTILE}", Data)
        service = Service(f"/s{NAME}", f"hostile/srv/S{HOSTILE}", Data, Data)
        topic_type, Data.__type_name__ = Data.__type_name__, f"hostile/msg/D{HOSTILE}"
        self._restored = topic_type
        publisher = self.node.publisher(topic)
        client = self.node.client(service)
        config = zenoh.Config()
        config.insert_json5("mode", '"peer"')
        config.insert_json5("connect/endpoints", json.dumps([self.endpoint]))
        config.insert_json5("scouting/multicast/enabled", "false")
        self._bare = zenoh.open(config)
        raw = self._bare.declare_publisher(f"raw{NAME}")
        numbered = iter(range(10**9))

        def publish() -> None:
            publisher.publish(Data())
            client.call(Data(), lambda _: None)
            raw.put(
                b"\xc1 is no MessagePack",
                encoding=zenoh.Encoding(f"application/msgpack;{HOSTILE}"),
                attachment=attachment(next(numbered), 0, f"raw{HOSTILE}".encode()),
            )

        self.node.every(0.05, publish)
        self._thread = threading.Thread(target=self.node.spin)
        self._thread.start()
        self.node.announce()

    def close(self) -> None:
        self.node.close()
        self._thread.join(30)
        self._bare.close()
        Data.__type_name__ = self._restored


@pytest.fixture
def publisher() -> Iterator[Publisher]:
    made = Publisher()
    yield made
    made.close()


@pytest.mark.zenoh
@pytest.mark.parametrize("options", [(), ("--json",), ("--stats",)], ids=str)
def test_a_tap_of_a_hostile_node_shows_it_harmlessly(
    options: tuple[str, ...], publisher: Publisher
) -> None:
    tap = OnTerminal("moon", "tap", *options, "--endpoint", publisher.endpoint)
    shown = "\\u001b]0;owned" if options == ("--json",) else "\\x1b]0;owned"
    tap.until(f"/c{shown}")
    tap.until("linked to 1 node: node\\x1b]0;owned")
    assert tap.end(signal.SIGINT) == 0
    require_harmless(tap.text)


@pytest.mark.zenoh
def test_a_monitor_of_a_hostile_system_shows_it_harmlessly(
    publisher: Publisher, tmp_path: Path
) -> None:
    properties = tmp_path / "properties.yaml"
    only = {**PROPERTIES, "properties": PROPERTIES["properties"][:1]}  # type: ignore[index]
    properties.write_text(json.dumps(only))
    arguments = ("--properties", properties, "--endpoint", publisher.endpoint)
    monitor = OnTerminal("moon", "monitor", *arguments)
    monitor.until("node\\x1b]0;owned")
    monitor.until("P\\x1b]0;owned")
    monitor.end(signal.SIGINT)
    require_harmless(monitor.text)


@pytest.mark.zenoh
def test_a_recording_of_a_hostile_system_is_made_and_used_harmlessly(
    publisher: Publisher, folder: Path, tmp_path: Path
) -> None:
    run = tmp_path / "run.mcap"
    record = OnTerminal("moon", "record", "-o", run, "--endpoint", publisher.endpoint, "--for", 2)
    assert record.end() == 0, record.text
    require_harmless(record.text)
    assert "linked to 1 node: node\\x1b]0;owned" in record.text
    for command in (
        ("check", run, folder / "level.scxml"),
        ("explain", folder / "level.scxml", "--recording", run),
        ("replay", run, "--as", HOSTILE, "--endpoint", publisher.endpoint),
    ):
        used = OnTerminal("moon", *command)
        used.end()
        require_harmless(used.text)
        assert "\\x1b]0;owned" in used.text, used.text


# --- a running system ------------------------------------------------------------------------------

NODE = """
import logging
import sys

from m2c.runtime.main import main

HOSTILE = {hostile!r}


class Node:
    def __init__(self, connection, settings):
        self.connection = connection

    def start(self):
        log = logging.getLogger(HOSTILE)
        log.warning("logged %s", HOSTILE)
        try:
            raise ValueError(HOSTILE)
        except ValueError:
            log.exception("raised %s", HOSTILE)
        print("printed", HOSTILE, flush=True)
        sys.stdout.buffer.write(b"bytes \\xff\\x1b]0;owned\\x07\\n")
        sys.stdout.buffer.flush()


main(Node, "node")
"""


@pytest.fixture
def system(tmp_path: Path) -> Path:
    """A generated system whose node is not so harmless."""
    package = tmp_path / "generated" / "node" / "hostile_node"
    package.mkdir(parents=True)
    (package / "__init__.py").touch()
    (package / "__main__.py").write_text(NODE.format(hostile=HOSTILE))
    node = {"name": f"node{HOSTILE}", "package": "hostile_node", "path": "node"}
    description = {"format": 1, "system": HOSTILE, "tick_rate_hz": 1.0, "nodes": [node]}
    (tmp_path / "generated" / "launch.json").write_text(json.dumps(description))
    return tmp_path / "generated"


@pytest.mark.zenoh
def test_what_nodes_log_and_write_is_shown_harmlessly(system: Path) -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{free.getsockname()[1]}"
    run = OnTerminal("m2c", "run", system, "--endpoint", endpoint)
    for word in ("logged ", "raised ", "ValueError: ", "printed ", "bytes \ufffd"):
        run.until(f"{word}\\x1b]0;owned\\x07")
    run.until("1 node is up")
    assert run.end(signal.SIGINT) == 0, run.text
    require_harmless(run.text.replace("Traceback (most recent call last):", ""))


@pytest.mark.zenoh
def test_a_node_on_a_terminal_of_its_own_logs_harmlessly(system: Path) -> None:
    program = system / "node" / "hostile_node" / "__main__.py"
    program.write_text(program.read_text().partition("        print(")[0] + 'main(Node, "node")\n')
    run = OnTerminal("python", "-m", "hostile_node", "--endpoint", "", cwd=program.parents[1])
    run.until("ValueError: \\x1b]0;owned")
    assert run.end(signal.SIGTERM) == 0
    require_harmless(run.text.replace("Traceback (most recent call last):", ""))
