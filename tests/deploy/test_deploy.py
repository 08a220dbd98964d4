"""``m2c deploy``: what systemd and containers are given starts the system."""

from __future__ import annotations

import configparser
import itertools
import os
import random
import re
import signal
import stat
from pathlib import Path

import pytest
import yaml
from click.testing import CliRunner

from m2c.cli import main
from m2c.codegen.names import snake
from m2c.deploy.files import DeployError, Hosting, deployment_files
from m2c.model.deployment import Process
from tests.keys.test_secure_runs import init
from tests.launch.system import Run, System
from tests.monitor.processes import free_endpoint
from tests.transports.hosts import ADDRESSES, may_be_made, two_hosts
from transports.zenoh_link.credentials import check

pytestmark = pytest.mark.slow

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


def test_a_unit_of_an_earlier_deployment_goes_unless_somebody_edited_it(system: System) -> None:
    plan = ("--deployment", str(system.folder / "deployment.xml"), "--endpoint", MEETING)
    _, _, output = deploy(system, *plan)
    units = output / "systemd"
    (units / "lab-base.service").write_text("[Service]\n")
    (units / "mine.service").write_text("[Service]\n")
    code, said, _ = deploy(system)
    assert code == 0, said
    assert "systemd/lab-Robot.1.service, of an earlier deployment, is removed" in said
    assert sorted(path.name for path in units.iterdir()) == [
        "lab-base.service",
        "lab.service",
        "mine.service",
    ]
    assert "is removed" not in deploy(system)[1]


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
        deployment_files("a", [], Hosting(prefix="/../..\n"))


HOSTILE = [
    *("robot", "Robot", "ROBOT", "robot-2", "a.b", "a-b", "a_b", "A.B", "a..b", "a-"),
    *(
        "1",
        "null",
        "true",
        "0x10",
        "1e3",
        "yes",
        "no",
        "on",
        "off",
        "n",
        "Null",
        "NULL",
        "0o17",
        "1_000",
    ),
    *("1.5", ".inf"[1:], "2026-11-25", "12.30.45", "False", "x" * 63),
]


def processes_of(hosts: list[str]) -> list[Process]:
    nodes = ["policy", *(f"N{number}" for number in range(len(hosts) - 1))]
    return [
        Process(name=f"p{number}", nodes=(node,), host=host)
        for number, (node, host) in enumerate(zip(nodes, hosts, strict=True))
    ]


@pytest.mark.parametrize("seed", range(40))
def test_each_host_has_a_unit_and_a_container_of_its_own_whatever_it_is_called(seed: int) -> None:
    chosen = random.Random(seed)
    hosts = chosen.sample(HOSTILE, chosen.randint(2, len(HOSTILE)))
    files = deployment_files("lab", processes_of(hosts), Hosting(endpoint=MEETING))
    units = [name for name in files if name.endswith(".service")]
    assert len({name.casefold() for name in units}) == len(hosts)
    services = yaml.safe_load(files["compose.yaml"])["services"]
    assert len(services) == len(hosts)
    assert len({name.casefold() for name in services}) == len(hosts)
    for name, service in services.items():
        assert re.fullmatch(r"[a-z0-9]([a-z0-9-]{0,64}[a-z0-9])?", name)
        assert service["hostname"] == name
        assert all(isinstance(word, str) for word in service["command"])
    said = [service["command"][-3] for service in services.values()]
    assert sorted(said) == sorted(hosts)  # `--host` is the deployment's own name
    (meeting,) = {service["command"][-1] for service in services.values()}
    first = next(name for name, service in services.items() if service["command"][-3] == hosts[0])
    assert meeting == f"tcp/{first}:7447"
    commands = [re.search(r"--host (\S+) --endpoint", files[name]) for name in units]
    assert sorted(found[1] for found in commands if found) == sorted(hosts)


@pytest.mark.parametrize("pair", [*itertools.permutations(["robot", "Robot", "robot-2"], 2)])
def test_names_that_differ_in_case_only_stay_apart(pair: tuple[str, str]) -> None:
    files = deployment_files("lab", processes_of([*pair]), Hosting(endpoint=MEETING))
    units = {name.casefold() for name in files if name.endswith(".service")}
    assert len(units) == 2


@pytest.mark.parametrize("name", ["1", "null", "yes", "~", "0x10", "1e3", "true"])
def test_a_system_may_be_called_as_something_else_in_yaml(name: str) -> None:
    files = deployment_files(name, [Process(name="p", nodes=("policy",))])
    (service,) = yaml.safe_load(files["compose.yaml"])["services"]
    assert service == (snake(name).replace("_", "-") or "system")


def test_containers_install_no_package_by_a_name_that_anybody_may_take(system: System) -> None:
    code, said, output = deploy(system)
    assert code == 0, said
    dockerfile = (output / "Dockerfile").read_text()
    assert "m2c-moon" not in dockerfile
    assert re.search(r"^ARG M2C$", dockerfile, re.MULTILINE)
    (service,) = yaml.safe_load((output / "compose.yaml").read_text())["services"].values()
    assert service["build"]["args"]["M2C"].startswith("${M2C:?set M2C to what pip installs")


def test_the_wheel_that_is_installed_is_copied(system: System) -> None:
    wheel = system.folder / "m2c_moon-0.1.0-py3-none-any.whl"
    wheel.write_bytes(b"a wheel")
    code, said, output = deploy(system, "--wheel", str(wheel))
    assert code == 0, said
    assert (output / wheel.name).read_bytes() == b"a wheel"
    assert f'ARG M2C="./{wheel.name}"' in (output / "Dockerfile").read_text()
    (service,) = yaml.safe_load((output / "compose.yaml").read_text())["services"].values()
    assert service["build"]["args"]["M2C"] == f"./{wheel.name}"


def test_a_unit_says_whose_its_processes_are(system: System) -> None:
    for options, user in (((), "m2c"), (("--user", "robot"), "robot")):
        code, said, output = deploy(system, *options)
        assert code == 0, said
        (service,) = (output / "systemd").iterdir()
        assert unit(service)["Service"]["User"] == user


def test_a_namespace_is_given_to_each_run(system: System) -> None:
    code, said, output = deploy(system, "--namespace", "robots/7")
    assert code == 0, said
    (service,) = (output / "systemd").iterdir()
    assert "--namespace robots/7" in unit(service)["Service"]["ExecStart"]


SECURE_MEETING = MEETING.replace("tcp/", "tls/")


def keys_for(system: System) -> Path:
    plan = TWO_HOSTS.replace(' priority="-5"', "")
    system.path.write_text(system.path.read_text().replace("</roaml>", f"{plan}</roaml>"))
    return init(system.folder / "keys", system.path)


def test_each_host_gets_the_keys_of_its_own_processes_only(system: System) -> None:
    keys = keys_for(system)
    for _ in range(2):  # and again, after one was moved
        code, said, output = deploy(system, "--endpoint", SECURE_MEETING, "--secure", str(keys))
        assert code == 0, said
        expected = {"Robot.1": ("brain", "m2c_run"), "base": ("arm", "m2c_run")}
        for host, names in expected.items():
            place = output / "keys" / host
            files = {f"{name}{end}" for name in names for end in (".pem", ".key", ".json5")}
            assert {file.name for file in place.iterdir()} == {"ca.pem", *files}
            for name in names:
                check(place, name)
                assert stat.S_IMODE((place / f"{name}.key").stat().st_mode) == 0o600
        (output / "keys" / "base" / "brain.key").touch()
    assert not list((output / "keys").rglob("ca.key"))
    started = unit(output / "systemd" / "lab-base.service")["Service"]["ExecStart"]
    assert started.endswith(f"--secure /opt/lab/keys --endpoint {SECURE_MEETING}")
    services = yaml.safe_load((output / "compose.yaml").read_text())["services"]
    assert services["robot-1"]["volumes"] == ["./keys/Robot.1:/keys:ro"]
    assert services["base"]["command"][-4:] == [
        *("--secure", "/keys", "--endpoint", "tls/robot-1:7447"),
    ]
    assert (output / ".dockerignore").read_text().split() == ["keys"]


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--endpoint", MEETING, "--secure", "keys"), "with certificates it begins with tls/"),
        (("--endpoint", SECURE_MEETING, "--secure", "none"), "does not exist: no certificates"),
        (("--endpoint", SECURE_MEETING, "--secure", "others"), "has no certificate of"),
        (("--transport", "ros2", "--secure", "keys"), "--secure is for zenoh"),
        (("--secure", "keys", "--namespace", "a"), "the certificates say it"),
        (("--endpoint", MEETING, "--namespace", "a//b"), "--namespace: namespace 'a//b': "),
        (("--endpoint", MEETING, "--user", "a b"), "expected a user's name"),
        (("--endpoint", MEETING, "--user", "x\nExecStop=y"), "expected a user's name"),
        (("--endpoint", MEETING, "--user", ""), "expected a user's name"),
        (("--endpoint", MEETING, "--wheel", "keys/ca.pem"), "expected the file of a wheel"),
    ],
)
def test_what_cannot_be_deployed_is_refused_before_anything_is_written(
    system: System, monkeypatch: pytest.MonkeyPatch, options: tuple[str, ...], said: str
) -> None:
    other = System(system.folder / "other")
    init(system.folder / "others", other.path)
    keys_for(system)
    monkeypatch.chdir(system.folder)
    code, output, folder = deploy(system, *options)
    assert code == 2
    assert said in output
    assert "Traceback" not in output
    assert not folder.exists()


@pytest.mark.zenoh
def test_the_images_context_has_no_keys_and_the_units_start_with_theirs(system: System) -> None:
    keys = keys_for(system)
    endpoint = free_endpoint().replace("tcp/", "tls/")
    code, said, output = deploy(system, "--endpoint", endpoint, "--secure", str(keys))
    assert code == 0, said
    runs = []
    for host in ("base", "Robot.1"):
        command = unit(output / "systemd" / f"lab-{host}.service")["Service"]["ExecStart"].split()
        words = [word for word in command[3:] if word != "--quiet"]
        words[words.index("--secure") + 1] = str(output / "keys" / host)
        runs.append(Run(output / "system", *words, endpoint=None))
    base, robot = runs
    robot.until("RUNNING  Level ok  Move ..")
    for run in (robot, base):
        run.process.send_signal(signal.SIGTERM)
        assert run.end() == 0, run.output


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
