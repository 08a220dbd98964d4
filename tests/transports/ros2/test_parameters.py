"""Numbers that a launch file sets, and a log that ROS 2's tools show."""

from __future__ import annotations

import logging
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from m2c.runtime.binding import Binding, NodeSettings
from tests.transports.ros2.bare import Bare
from transports.interface import TransportError
from transports.networks import PATIENCE_S, ThreadedNetwork

pytestmark = pytest.mark.ros2

ROOT = Path(__file__).parents[3]
BATTERY = ROOT / "examples" / "lab_tour" / "components" / "BatteryComponent.ascxml"
WAIT = ROOT / "examples" / "lab_tour" / "skills" / "WaitSkill.scxml"
NAME = "rate_hz.measure"


@pytest.mark.parametrize(
    ("written", "value"), [("", 2.0), (f"-p {NAME}:=4", 4.0), (f"-p {NAME}:=0.5", 0.5)]
)
def test_a_parameter_is_what_the_launcher_set_or_the_default(written: str, value: float) -> None:
    from transports.ros2 import connect

    node = connect("node", {"args": written} if written else {})
    try:
        assert node.parameter(NAME, 2.0, "how often") == value
        assert node.parameter(NAME, 2.0, "how often") == value  # asked for again
    finally:
        node.close()


@pytest.mark.parametrize("value", ["fast", "0.0", "-1", "true", ".nan", ".inf", "[1.0, 2.0]"])
def test_a_parameter_that_is_no_positive_number_is_one_clear_error(value: str) -> None:
    from transports.ros2 import connect

    node = connect("node", {"args": f"-p {NAME}:='{value}'"})
    try:
        with pytest.raises(TransportError, match=r"rate_hz\.measure is .*: expected a positive"):
            node.parameter(NAME, 2.0, "how often")
    finally:
        node.close()


@pytest.mark.parametrize(
    ("written", "value"),
    [("", None), ("3", 3), ("0.5", 0.5), ("true", True), ("text", "text"), ("[1, 2]", [1, 2])],
)
def test_what_a_launcher_gives_is_had_as_it_is(written: str, value: object) -> None:
    from transports.ros2 import connect

    node = connect("node", {"args": f"-p poi:='{written}'"} if written else {})
    try:
        found = node.given("poi", "what poi begins with")
        assert (list(found) if isinstance(value, list) else found) == value
    finally:
        node.close()


def test_a_parameter_cannot_be_changed_when_it_has_been_read(
    network: ThreadedNetwork, bare: Bare
) -> None:
    from rcl_interfaces.srv import SetParameters
    from rclpy.parameter import Parameter

    node = network.node("node")
    node.parameter(NAME, 2.0, "how often")  # type: ignore[attr-defined] - of this transport
    client = bare.node.create_client(SetParameters, "/node/set_parameters")
    assert client.wait_for_service(PATIENCE_S)
    changed = Parameter(NAME, value=9.0).to_parameter_msg()
    request = SetParameters.Request(parameters=[changed])
    answers: list[Any] = []

    def is_answered() -> bool:
        answers.append(client.call(request, 2.0))  # the first one may go to nobody: DDS is matching
        return answers[-1] is not None

    assert network.until(is_answered)
    assert not answers[-1].results[0].successful
    assert "read-only" in answers[-1].results[0].reason


def test_a_timer_of_a_model_fires_as_often_as_its_parameter_says() -> None:
    from transports.ros2 import connect

    node = connect("node", {"args": f"-p {NAME}:=5.0"})
    periods: list[float] = []
    node.every = lambda period_s, handler: periods.append(period_s)  # type: ignore[method-assign,assignment,return-value] - heard, not run
    try:
        binding = Binding(node, "node", NodeSettings(), lambda: "")
        binding.timer(2.0, lambda: None, "measure")
        binding.timer(2.0, lambda: None, "other")
    finally:
        node.close()
    assert periods == [0.2, 0.5]


def test_what_a_node_logs_is_heard_on_rosout(network: ThreadedNetwork, bare: Bare) -> None:
    from rcl_interfaces.msg import Log
    from rclpy.qos import qos_profile_system_default

    heard: list[tuple[int, str]] = []
    bare.node.create_subscription(
        Log,
        "/rosout",
        lambda log: heard.append((log.level, log.msg)) if log.name == "node" else None,
        qos_profile_system_default,
    )
    node = network.node("node")
    handler = node.log_handler(logging.DEBUG)  # type: ignore[attr-defined] - of this transport

    def logged(name: str, level: int, text: str) -> bool:
        def once() -> bool:
            handler.handle(logging.LogRecord(name, level, "", 0, "%s", (text,), None))
            return (level, text if name == "node" else f"{name}: {text}") in heard

        return network.until(once)

    assert logged("node", logging.ERROR, "a")
    assert logged("node", logging.WARNING, "b")
    assert logged("node", logging.INFO, "c")
    assert logged("node", logging.DEBUG, "d")
    assert logged("transports.ros2", logging.CRITICAL, "e")


def generated(model: Path, folder: Path) -> None:
    """``model`` as a package in ``folder``."""
    m2c = [sys.executable, "-m", "m2c.cli", "generate", str(model), "--transport", "ros2"]
    interfaces = ["--interfaces", str(ROOT / "examples" / "lab_tour" / "interfaces")]
    subprocess.run([*m2c, *interfaces, "-o", str(folder)], check=True, capture_output=True)


@pytest.mark.slow
def test_a_generated_node_has_its_rates_and_its_patience_as_parameters(
    bare: Bare, tmp_path: Path
) -> None:
    from rcl_interfaces.srv import GetParameters

    generated(BATTERY, tmp_path)
    client = bare.node.create_client(GetParameters, "/battery/get_parameters")
    arguments = [
        "--ros-args",
        "-r",
        "__node:=battery",
        "-p",
        f"{NAME}:=7.5",
        "-p",
        "percentage:=20",
    ]
    with subprocess.Popen(
        [sys.executable, "-m", "battery_component", *arguments],
        cwd=tmp_path / "battery_component",
    ) as node:
        try:
            assert client.wait_for_service(PATIENCE_S)
            request = GetParameters.Request(names=[NAME, "call_timeout_s", "percentage"])

            def values() -> list[float]:
                answer = client.call(
                    request, 2.0
                )  # the first one may go to nobody: DDS is matching
                found = [] if answer is None else answer.values
                return [value.double_value or value.integer_value for value in found]

            while values() != [
                7.5,
                5.0,
                20,
            ]:  # it serves its parameters before it has declared its own
                assert node.poll() is None
        finally:
            node.send_signal(signal.SIGINT)
        assert node.wait(PATIENCE_S) == 0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("model", "package", "arguments", "said"),
    [
        (
            BATTERY,
            "battery_component",
            ["-p", f"{NAME}:=fast"],
            "error: the parameter rate_hz.measure is 'fast': expected a positive number",
        ),
        (
            BATTERY,
            "battery_component",
            ["-p", "percentage:=low"],
            "error: the parameter percentage is 'low': expected int32",
        ),
        (
            WAIT,
            "wait_skill",
            [],
            "error: the type `bt_interfaces/srv/TickAction_Event` needs the ROS 2 interface package "
            "`bt_interfaces`, which cannot be loaded",
        ),
    ],
)
def test_a_generated_node_that_cannot_start_says_why_in_one_line(
    tmp_path: Path, model: Path, package: str, arguments: list[str], said: str
) -> None:
    generated(model, tmp_path)
    done = subprocess.run(
        [sys.executable, "-m", package, "--ros-args", *arguments],
        cwd=tmp_path / package,
        env={name: value for name, value in os.environ.items() if name != "PYTHONPATH"},
        capture_output=True,
        text=True,
        check=False,
        timeout=PATIENCE_S,
    )
    assert done.returncode == 2
    assert done.stderr.startswith(said), done.stderr
    assert "Traceback" not in done.stderr
    assert len(done.stderr.splitlines()) == 1
