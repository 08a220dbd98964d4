"""``m2c deploy``: what systemd and containers are given starts the system."""

from __future__ import annotations

import configparser
import os
import signal
from pathlib import Path

import pytest
import yaml
from click.testing import CliRunner

from m2c.cli import main
from m2c.deploy.files import DeployError, deployment_files
from m2c.model.deployment import Process
from tests.launch.system import Run, System
from tests.transports.hosts import ADDRESSES, may_be_made, two_hosts

MEETING = f"tcp/{ADDRESSES[0]}:7447"
TWO_HOSTS = (
    '<deployment><process name="brain" host="Robot.1" priority="-5"><node name="policy"/>'
    '<node name="LevelSkill"/></process><process name="arm" host="base"><node name="MoveSkill"/></process>'
    "</deployment>"
)


@pytest.fixture
def system(tmp_path: Path) -> System:
    made = System(tmp_path / "lab")
    (made.folder / "deployment.xml").write_text(TWO_HOSTS)
    return made


def deploy(system: System, *options: str) -> tuple[int, str, Path]:
    output = system.folder / "deployed"
    arguments = ["deploy", str(system.path), "-o", str(output), *options]
    done = CliRunner().invoke(main, arguments)
    return done.exit_code, done.output, output


def unit(file: Path) -> configparser.ConfigParser:
    parsed = configparser.ConfigParser(interpolation=None)
    parsed.optionxform = str  # type: ignore[assignment,method-assign]
    parsed.read(file)
    return parsed


def test_each_host_has_a_unit_and_a_container(system: System) -> None:
    plan = str(system.folder / "deployment.xml")
    code, said, output = deploy(system, "--deployment", plan, "--endpoint", MEETING)
    assert code == 0, said
    assert said.startswith("lab: Robot.1, base in ")
    robot = unit(output / "systemd" / "lab-Robot.1.service")
    command = (
        f"system --transport zenoh --restart on-failure --quiet --host Robot.1 --endpoint {MEETING}"
    )
    assert robot["Service"]["ExecStart"] == f"/opt/lab/venv/bin/m2c run {command}"
    assert robot["Service"]["AmbientCapabilities"] == "CAP_SYS_NICE"
    assert robot["Service"]["Restart"] == "on-failure"
    base = unit(output / "systemd" / "lab-base.service")
    assert "AmbientCapabilities" not in base["Service"]
    services = yaml.safe_load((output / "compose.yaml").read_text())["services"]
    assert sorted(services) == ["base", "robot-1"]
    assert services["robot-1"]["cap_add"] == ["SYS_NICE"]
    assert services["base"]["command"][-4:] == ["--host", "base", "--endpoint", "tcp/robot-1:7447"]


def test_a_system_without_a_deployment_has_one_of_each(system: System) -> None:
    code, said, output = deploy(system, "--prefix", "/srv/lab")
    assert code == 0, said
    (service,) = (output / "systemd").iterdir()
    assert service.name == "lab.service"
    start = unit(service)["Service"]["ExecStart"]
    assert (
        start == "/srv/lab/venv/bin/m2c run system --transport zenoh --restart on-failure --quiet"
    )
    (container,) = yaml.safe_load((output / "compose.yaml").read_text())["services"].values()
    assert container["command"] == start.removeprefix("/srv/lab/venv/bin/").split()


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ((), "give --endpoint, e.g. tcp/192.168.1.10:7447, of Robot.1"),
        (("--endpoint", "10.0.0.1:7447"), "expected <protocol>/<address>"),
        (("--endpoint", "tcp/h:1 --evil"), "expected <protocol>/<address>"),
        (("--endpoint", MEETING, "--prefix", "opt"), "expected an absolute path"),
        (("--endpoint", MEETING, "--prefix", "/opt/a b"), "expected an absolute path"),
        (("--endpoint", MEETING, "--prefix", "/opt/%h\nExecStop=x"), "expected an absolute path"),
    ],
)
def test_what_is_no_address_or_no_folder_is_refused(
    system: System, options: tuple[str, ...], said: str
) -> None:
    code, output, _ = deploy(
        system, "--deployment", str(system.folder / "deployment.xml"), *options
    )
    assert code == 2
    assert said in output


def test_the_name_of_a_system_is_no_part_of_a_unit_but_as_a_plain_word() -> None:
    files = deployment_files("a%h\n[Service] $x", [Process(name="p", nodes=("policy",))])
    (name,) = (name for name in files if name.endswith(".service"))
    assert name == "systemd/a_h_service_x.service"
    assert "%" not in files[name]
    with pytest.raises(DeployError):
        deployment_files("a", [], prefix="/../..\n")


@pytest.mark.zenoh
@pytest.mark.skipif(not may_be_made(), reason="only root may make network namespaces")
def test_what_the_units_start_is_one_system_on_two_hosts(system: System) -> None:
    plan = str(system.folder / "deployment.xml")
    code, said, output = deploy(system, "--deployment", plan, "--endpoint", MEETING)
    assert code == 0, said
    commands = [
        unit(output / "systemd" / f"lab-{host}.service")["Service"]["ExecStart"].split()[2:]
        for host in ("base", "Robot.1")
    ]
    with two_hosts() as (here, there):
        base, robot = (
            Run(
                output / "system",
                *(word for word in command[1:] if word != "--quiet"),
                endpoint=None,
                inside=host,
            )
            for command, host in zip(commands, (there, here), strict=True)
        )
        robot.until("RUNNING  Level ok  Move ..")
        assert os.getpriority(os.PRIO_PROCESS, robot.children()["policy"]) == -5
        for run in (robot, base):
            run.process.send_signal(signal.SIGTERM)
            assert run.end() == 0, run.output
