"""`m2c doctor` says what works, what is missing and what is wrong here, and the command that mends it."""

from __future__ import annotations

import contextlib
import importlib.metadata
import json
import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from m2c.cli import main
from m2c.doctor import host
from tests.transports.ros2_network import own_domain
from transports import diagnosis, ros_diagnosis
from transports.descriptions import OWN, Description
from transports.diagnosis import Finding, State
from transports.zenoh_link import diagnosis as zenoh_diagnosis
from transports.zenoh_link.session import open_session

pytestmark = pytest.mark.slow


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port: int = server.getsockname()[1]
    return port


def doctor(
    *arguments: str, environment: dict[str, str] | None = None
) -> tuple[int, list[dict[str, Any]], str]:
    """Exit code, findings, and what it says on standard error."""
    done = subprocess.run(
        [sys.executable, "-m", "m2c.cli", "doctor", "--json", *arguments],
        env={**os.environ, **(environment or {})}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    return done.returncode, [json.loads(line) for line in done.stdout.splitlines()], done.stderr


def of(findings: list[dict[str, Any]], subject: str) -> list[dict[str, Any]]:
    return [finding for finding in findings if finding["subject"] == subject]


@pytest.mark.zenoh
def test_all_that_works_is_named_and_the_exit_code_is_0() -> None:
    code, found, said = doctor("--transport", "zenoh", "--endpoint", f"tcp/127.0.0.1:{free_port()}")
    assert (code, said) == (0, "")
    assert {f["subject"] for f in found} >= {
        "python",
        "packages",
        "clock",
        "zenoh",
        "loopback",
        "gossip",
    }
    assert {f["state"] for f in found} <= {"works", "note"}
    assert all(f["format_version"] == 1 for f in found)
    (endpoint,) = of(found, "endpoint")
    assert "is free" in endpoint["text"]


@pytest.mark.zenoh
def test_a_host_without_a_network_is_told_that_and_what_mends_it() -> None:
    command = ["unshare", "-rn", sys.executable, "-m", "m2c.cli", "doctor", "--transport", "zenoh"]
    if subprocess.run(["unshare", "-rn", "true"], check=False, capture_output=True).returncode:
        pytest.skip("no network namespace can be made")
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert "127.0.0.1 cannot be reached" in done.stdout
    assert "→ ip link set lo up" in done.stdout
    assert "gossip" not in done.stdout  # of which nothing can be known
    assert "Traceback" not in done.stdout + done.stderr


@contextlib.contextmanager
def listening() -> Iterator[int]:
    """A port at which something listens that is not Zenoh: it closes each connection."""
    import threading

    server = socket.create_server(("127.0.0.1", 0))

    def serve() -> None:
        with contextlib.suppress(OSError):
            while True:
                server.accept()[0].close()

    thread = threading.Thread(target=serve)
    thread.start()
    yield server.getsockname()[1]
    server.shutdown(socket.SHUT_RDWR)
    server.close()
    thread.join()


@pytest.mark.zenoh
def test_who_is_at_the_endpoint_is_found() -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with open_session({"listen": endpoint}):
        found = zenoh_diagnosis.at_endpoint(endpoint, {})
        assert found.state is State.WORKS
        assert found.text.startswith(f"no router is at {endpoint}; 1 process of Zenoh")
    with open_session({"listen": endpoint, "mode": "router"}):
        found = zenoh_diagnosis.at_endpoint(endpoint, {})
        assert (found.state, found.text) == (State.WORKS, f"a router is at {endpoint}")
    with listening() as port:
        found = zenoh_diagnosis.at_endpoint(f"tcp/127.0.0.1:{port}", {})
        assert found.state is State.WRONG
        assert "no Zenoh session opens there" in found.text
        assert f"sport = :{port}" in found.mend


@pytest.mark.zenoh
@pytest.mark.parametrize(
    ("options", "looked_at"),
    [
        ({}, ["tcp/127.0.0.1:7447"]),
        ({"endpoint": ""}, ["tcp/127.0.0.1:7447"]),
        ({"endpoint": "", "secure": "no_such_keys"}, ["tls/127.0.0.1:7447"]),
        ({"endpoint": "tcp/127.0.0.1:1, tcp/127.0.0.1:2"}, ["tcp/127.0.0.1:1", "tcp/127.0.0.1:2"]),
    ],
)
def test_the_endpoint_that_nobody_names_is_looked_at_too(
    monkeypatch: pytest.MonkeyPatch, options: dict[str, str], looked_at: list[str]
) -> None:
    def named(endpoint: str, _: object) -> Finding:
        return Finding(State.WORKS, "endpoint", endpoint)

    monkeypatch.setattr(zenoh_diagnosis, "at_endpoint", named)
    found = zenoh_diagnosis.diagnose(options)
    assert [one.text for one in found if one.subject == "endpoint"] == looked_at


@pytest.mark.parametrize(
    ("endpoint", "said"),
    [
        ("nonsense", "is not an endpoint"),
        ("tcp/127.0.0.1", "is not an endpoint"),
        ("tcp/127.0.0.1:x", "is not an endpoint"),
        ("tcp/127.0.0.1:99999", "is not an endpoint"),
        ("tcp/no-such-host.invalid:7447", "there is no host"),
        ("tcp/a..b:7447", "there is no host"),
        (f"tcp/{'x' * 100}:7447", "there is no host"),
        ("\x1b[31m", "is not an endpoint"),
    ],
)
def test_an_endpoint_that_cannot_be_is_wrong(endpoint: str, said: str) -> None:
    found = zenoh_diagnosis.at_endpoint(endpoint, {})
    assert found.state is State.WRONG
    assert said in found.text
    assert found.mend


def test_folders_of_certificates_are_looked_at(tmp_path: Path) -> None:
    from moon.cli import main as moon

    root = Path(__file__).parents[2]
    none = list(zenoh_diagnosis.certificates(tmp_path / "none"))
    assert [f.state for f in none] == [State.WRONG]
    assert "moon keys init" in none[0].mend
    keys = tmp_path / "keys"
    system = root / "examples/lab_tour/system.xml"
    assert CliRunner().invoke(moon, ["keys", "init", str(keys), str(system)]).exit_code == 0
    good = list(zenoh_diagnosis.certificates(keys))
    assert len(good) > 10
    assert {f.state for f in good} == {State.WORKS}
    (keys / "policy.pem").write_text("no certificate")
    bad = [f for f in zenoh_diagnosis.certificates(keys) if f.state is State.WRONG]
    assert len(bad) == 1
    assert "policy.pem" in bad[0].text
    assert "moon keys renew" in bad[0].mend


def test_variables_of_zenoh_that_nothing_reads_are_named_with_what_does_it_here() -> None:
    named = {"ZENOH_CONFIG": "x.json5", "ZENOH_RUNTIME": "(rx: ())", "ZENOH_TYPO": "1", "HOME": "/"}
    found = {f.text.partition("=")[0]: f for f in zenoh_diagnosis.variables(named)}
    assert set(found) == {"ZENOH_CONFIG", "ZENOH_RUNTIME", "ZENOH_TYPO"}
    assert "--zenoh-config" in found["ZENOH_CONFIG"].mend
    assert found["ZENOH_TYPO"].mend == "unset ZENOH_TYPO"


@pytest.mark.zenoh
def test_a_variable_that_ends_zenoh_is_found_out() -> None:
    code, found, _ = doctor("--transport", "zenoh", environment={"ZENOH_RUNTIME": "nonsense"})
    assert code == 1
    assert [f for f in found if f["state"] == "wrong"]
    assert any(
        "ZENOH_RUNTIME=nonsense" in f["text"] and f["mend"] == "unset ZENOH_RUNTIME" for f in found
    )


@pytest.mark.parametrize(
    ("name", "value", "state", "mend"),
    [
        ("ROS_DOMAIN_ID", "7", State.WORKS, ""),
        ("ROS_DOMAIN_ID", "233", State.WRONG, "export ROS_DOMAIN_ID=0"),
        ("ROS_DOMAIN_ID", "-1", State.WRONG, "export ROS_DOMAIN_ID=0"),
        ("ROS_DOMAIN_ID", "٣", State.WRONG, "export ROS_DOMAIN_ID=0"),
        ("ROS_DOMAIN_ID", "", State.WRONG, "export ROS_DOMAIN_ID=0"),
        ("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST", State.WORKS, ""),
        ("ROS_AUTOMATIC_DISCOVERY_RANGE", "localhost", State.WRONG, "=LOCALHOST"),
        ("ROS_AUTOMATIC_DISCOVERY_RANGE", "OFF", State.WRONG, "=LOCALHOST"),
        ("ROS_LOCALHOST_ONLY", "1", State.NOTE, "ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST"),
        ("ROS_LOCALHOST_ONLY", "yes", State.WRONG, "unset ROS_LOCALHOST_ONLY"),
        ("ROS_DISTRO", "jazzy", State.WORKS, ""),
        ("ROS_DISTRO", "humble", State.WRONG, "setup.bash"),
        ("ROS_VERSION", "1", State.WRONG, "new shell"),
        (
            "RMW_IMPLEMENTATION",
            "rmw_nonsense_cpp",
            State.WRONG,
            "pip install ros-jazzy-rmw-nonsense-cpp",
        ),
        ("ROS_DISCOVERY_SERVER", "10.0.0.1:11811", State.NOTE, "unset ROS_DISCOVERY_SERVER"),
        ("FASTRTPS_DEFAULT_PROFILES_FILE", "/no/such.xml", State.WRONG, "unset FASTRTPS"),
        ("FASTRTPS_DEFAULT_PROFILES_FILE", "/", State.WRONG, "unset FASTRTPS"),
        ("FASTRTPS_DEFAULT_PROFILES_FILE", __file__, State.WRONG, "mend the file"),
        ("FASTDDS_ENVIRONMENT_FILE", "/no/such.json", State.WRONG, "unset FASTDDS"),
        ("FASTDDS_ENVIRONMENT_FILE", __file__, State.WRONG, "mend the file"),
        (
            "FASTDDS_DEFAULT_PROFILES_FILE",
            "a.xml",
            State.NOTE,
            "export FASTRTPS_DEFAULT_PROFILES_FILE=a.xml",
        ),
        ("FASTDDS_BUILTIN_TRANSPORTS", "UDPv4", State.WORKS, ""),
        ("FASTDDS_BUILTIN_TRANSPORTS", "LARGE_DATA?max_msg_size=1MB", State.WORKS, ""),
        ("FASTDDS_BUILTIN_TRANSPORTS", "udpv4", State.WRONG, "=UDPv4"),
        ("FASTDDS_BUILTIN_TRANSPORTS", "tcp", State.WRONG, "unset FASTDDS"),
        ("RMW_FASTRTPS_PUBLICATION_MODE", "sync", State.WRONG, "unset RMW_FASTRTPS"),
        ("RMW_FASTRTPS_USE_QOS_FROM_XML", "true", State.WRONG, "unset RMW_FASTRTPS"),
        ("CYCLONEDDS_URI", "file:///no/such.xml", State.NOTE, "=rmw_cyclonedds_cpp"),
        ("ROS_SECURITY_ENABLE", "True", State.WRONG, "export ROS_SECURITY_ENABLE=true"),
        ("ROS_SECURITY_ENABLE", "true", State.WRONG, "create_keystore"),
        ("ROS_SECURITY_ENABLE", "false", State.WORKS, ""),
        ("ROS_SECURITY_STRATEGY", "enforce", State.WRONG, "=Enforce"),
        ("ROS_MASTER_URI", "http://localhost:11311", State.NOTE, "unset ROS_MASTER_URI"),
        ("AMENT_PREFIX_PATH", "/no/such/folder", State.WRONG, "new shell"),
    ],
)
def test_variables_of_ros_2_are_judged(name: str, value: str, state: State, mend: str) -> None:
    (found,) = ros_diagnosis.variables({name: value})
    assert found.state is state
    assert name in found.text
    assert mend in found.mend


@pytest.mark.parametrize(
    ("rmw", "name", "value", "said"),
    [
        ("rmw_cyclonedds_cpp", "CYCLONEDDS_URI", "file://{0}/a.xml", ""),
        (
            "rmw_cyclonedds_cpp",
            "CYCLONEDDS_URI",
            "{0}/a.xml,file://{0}/b.xml",
            "b.xml: No such file",
        ),
        ("rmw_cyclonedds_cpp", "CYCLONEDDS_URI", "{0}/a.xml,<CycloneDDS>c,d</CycloneDDS>", ""),
        ("rmw_zenoh_cpp", "ZENOH_ROUTER_CONFIG_URI", "{0}/a.xml", ""),
        ("rmw_zenoh_cpp", "ZENOH_ROUTER_CONFIG_URI", "{0}/r.json5", "r.json5: No such file"),
        ("rmw_zenoh_cpp", "ZENOH_SESSION_CONFIG_URI", "{0}", "Is a directory"),
        ("rmw_fastrtps_cpp", "FASTRTPS_DEFAULT_PROFILES_FILE", "{0}/a.xml", ""),
        ("rmw_fastrtps_dynamic_cpp", "FASTRTPS_DEFAULT_PROFILES_FILE", "{0}/x", "x: No such file"),
    ],
)
def test_files_that_the_middleware_in_use_reads_are_looked_at(
    tmp_path: Path, rmw: str, name: str, value: str, said: str
) -> None:
    (tmp_path / "a.xml").write_text("<profiles/>")
    environment = {"RMW_IMPLEMENTATION": rmw, name: value.format(tmp_path)}
    (found,) = (f for f in ros_diagnosis.variables(environment) if f.text.startswith(name))
    assert found.state is (State.WRONG if said else State.WORKS)
    assert said in found.text


@pytest.mark.parametrize(
    ("keystore", "state"), [("", "wrong"), ("/no/such", "wrong"), ("/", "works")]
)
def test_security_without_a_keystore_is_wrong(keystore: str, state: str) -> None:
    environment = {"ROS_SECURITY_ENABLE": "true", "ROS_SECURITY_KEYSTORE": keystore}
    assert [f.state for f in ros_diagnosis.variables(environment)] == [state, "works"]


def test_a_domain_whose_ports_anybody_may_be_given_is_wrong(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ports = tmp_path / "range"
    ports.write_text("32768\t60999\n")
    monkeypatch.setattr(ros_diagnosis, "_EPHEMERAL", ports)
    states = {
        d: next(ros_diagnosis.variables({"ROS_DOMAIN_ID": str(d)})).state
        for d in (0, 100, 102, 214, 216)
    }
    works = {d for d, state in states.items() if state is State.WORKS}
    assert works == {0, 100, 216}


def test_wheels_that_are_missing_have_the_names_that_pip_takes() -> None:
    assert ros_diagnosis.missing_wheels(
        [
            'ros-jazzy-no-such-msgs; extra == "ros2"',
            'no-such-tool==3.3.4; extra == "ros2"',
            'click>=8.1; extra == "ros2"',
            'not-asked-for; extra == "dev"',
            "not-either>=1",
        ]
    ) == ["ros-jazzy-no-such-msgs", "no-such-tool==3.3.4"]


def test_a_transport_that_is_absent_is_missing_but_wrong_only_where_it_is_asked_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    lacks = Finding(State.MISSING, "ros2", "rclpy is not installed", "pip install 'm2c-moon[ros2]'")
    monkeypatch.setattr(diagnosis, "diagnose", lambda *_: [lacks])
    by_chance = CliRunner().invoke(main, ["doctor"])
    assert by_chance.exit_code == 0
    assert "→ pip install 'm2c-moon[ros2]'" in by_chance.output
    assert CliRunner().invoke(main, ["doctor", "--transport", "ros2"]).exit_code == 1


def test_rclpy_is_found_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ros_diagnosis.importlib.util, "find_spec", lambda _: None)
    *_, last = ros_diagnosis.diagnose({})
    assert (last.state, last.subject) == (State.MISSING, "ros2")
    assert last.mend.startswith("pip install 'm2c-moon[ros2]'")


@pytest.mark.ros2
def test_two_nodes_on_ros_2_reach_one_another() -> None:
    with own_domain():
        code, found, _ = doctor("--transport", "ros2")
    assert code == 0, found
    assert any("reaches another" in f["text"] for f in found)


@pytest.mark.parametrize(
    ("body", "said"),
    [
        (
            "import os, signal; os.kill(os.getpid(), signal.SIGSEGV)",
            "after `first`, the check ended by SIGSEGV",
        ),
        ("import os; os._exit(70)", "after `first`, the check ended with code 70"),
        (
            "raise ValueError('so it is')",
            "after `first`, the check ended with code 1: ValueError: so it is",
        ),
        (
            "import threading; threading.Event().wait()",
            "after `first`, the check did not end within 2 s",
        ),
        ("print('noise')", ""),
    ],
)
def test_a_middleware_that_ends_its_process_or_hangs_is_a_finding(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, body: str, said: str
) -> None:
    (tmp_path / "broken.py").write_text(
        "from transports.diagnosis import Finding, State\n"
        "from transports.descriptions import OWN, Description\n"
        "def look(options):\n"
        "    yield Finding(State.WORKS, 'first', 'it was looked at')\n"
        f"    {body}\n"
    )
    (tmp_path / "sitecustomize.py").write_text(
        "from transports.descriptions import OWN, Description\n"
        "OWN['broken'] = Description(diagnosis='broken:look')\n"
    )
    monkeypatch.setenv(
        "PYTHONPATH", os.pathsep.join([str(tmp_path), str(Path(__file__).parents[2])])
    )
    found = diagnosis.diagnose("broken", {}, 2.0)
    assert found[0].subject == "first"
    assert [f.text for f in found[1:]] == ([said] if said else [])
    assert all(f.state is State.WRONG for f in found[1:])


def test_a_transport_of_others_is_loaded() -> None:
    assert [f.state for f in diagnosis.diagnose("simulated", {})] == [State.WORKS]
    assert [f.state for f in diagnosis.diagnose("no_such", {})] == [State.WRONG]
    assert OWN["simulated"] == Description(is_one_process=True)


@pytest.mark.parametrize(
    ("version", "state"),
    [((3, 10), State.WRONG), ((3, 11), State.WORKS), ((3, 12), State.WORKS), ((3, 13), State.NOTE)],
)
def test_pythons_are_told_apart(version: tuple[int, int], state: State) -> None:
    found = host.python(version)
    assert found.state is state
    assert bool(found.mend) == (state is not State.WORKS)


def test_packages_that_are_missing_are_named_as_pip_takes_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found = importlib.metadata.version

    def without(name: str) -> str:
        if name in ("rich", "lz4"):
            raise importlib.metadata.PackageNotFoundError(name)
        return found(name)

    monkeypatch.setattr(importlib.metadata, "version", without)
    lacking = host.packages()
    assert lacking.state is State.WRONG
    assert lacking.mend == "pip install 'lz4>=4.4' 'rich>=14.0'"


def test_a_clock_that_was_never_set_is_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(host.time, "time", lambda: 86_400.0)
    assert host.clock().state is State.WRONG


def test_a_transport_that_is_misspelt_is_refused() -> None:
    done = CliRunner().invoke(main, ["doctor", "--transport", "zenohh"])
    assert done.exit_code == 2
    assert done.output == "error: no transport zenohh is installed; did you mean zenoh?\n"
