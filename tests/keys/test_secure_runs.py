"""``m2c run`` and ``moon`` with certificates: a nominal run is conforming, and intruders do not disturb it."""

from __future__ import annotations

import contextlib
import signal
import socket
import ssl
import subprocess
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest

from tests.keys.intruder import Attempt
from tests.keys.secured import Intruder, with_foreign_certificate
from tests.launch.system import System
from tests.monitor.processes import BIN, Monitor, Process, free_endpoint
from tests.transports.hosts import ADDRESSES, may_be_made, two_hosts

pytestmark = pytest.mark.zenoh

CELL = Path(__file__).parents[2] / "examples" / "sorting_cell" / "system.xml"
NODES = ("LevelSkill", "MoveSkill", "policy")


def init(folder: Path, system: Path) -> Path:
    subprocess.run(
        [str(BIN / "moon"), "keys", "init", str(folder), str(system)],
        check=True,
        capture_output=True,
    )
    return folder


@pytest.fixture
def here(tmp_path: Path) -> tuple[System, Path]:
    system = System(tmp_path / "lab")
    return system, init(tmp_path / "keys", system.path)


@contextlib.contextmanager
def running(
    system: System, keys: Path, endpoint: str, hosts: Sequence[Sequence[str]]
) -> Iterator[tuple[Monitor, Process, Process]]:
    """The system, the monitor on the first host and, if there are two, the policy on the second."""
    first, last = hosts[0], hosts[-1]
    secure = ("--secure", keys, "--endpoint", endpoint)
    with contextlib.ExitStack() as stack:

        def start(*command: object, inside: Sequence[str]) -> Process:
            return stack.enter_context(
                contextlib.closing(Process(*command, *secure, inside=inside))
            )

        monitor = Monitor(system.path, *secure, inside=first)
        stack.enter_context(contextlib.closing(monitor))
        monitor.until_listening()
        nodes = start("m2c", "run", system.path, "--without", "policy", inside=first)
        nodes.until(lambda: "2 nodes are up" in nodes.said)
        policy = start("m2c", "run", system.path, "--only", "policy", "--rate", 20, inside=last)
        policy.until(lambda: ticks(policy))
        yield monitor, nodes, policy


def ticks(policy: Process) -> int:
    return sum("Level ok  Move .." in line for line in policy.out)


def attack(
    system: System, keys: Path, endpoint: str, tmp_path: Path, hosts: Sequence[Sequence[str]]
) -> None:
    with running(system, keys, endpoint, hosts) as (monitor, nodes, policy):
        observer = Attempt(
            folder=str(keys),
            name="observer",
            endpoint=endpoint,
            fence="**",
            nodes=NODES,
            topic="policy/ticks",
            service="LevelSkill/tick",
            secret="policy/ticks",
        )
        with contextlib.closing(Intruder(observer, hosts[-1])) as intruder:
            assert intruder.said() == {"opened": True, "fence": True}
            assert intruder.end() == {"replies": [], "asked": [], "secret": True}
        for name in ("", "LevelSkill"):
            folder = keys
            if name:
                folder = with_foreign_certificate(keys, tmp_path / "expired", name, expired=True)
            stranger = Attempt(folder=str(folder), name=name, endpoint=endpoint)
            with contextlib.closing(Intruder(stranger, hosts[-1])) as intruder:
                assert intruder.said()["opened"] is False
        before = ticks(policy)
        policy.until(lambda: ticks(policy) > before + 5)
        for process in (policy, nodes):
            assert process.end(signal.SIGINT) == 0, process.said
        assert monitor.end(signal.SIGINT) == 0, monitor.said
        outcomes = {found["machine"]: found["verdict"] for found in monitor.summary["machines"]}
        assert outcomes == dict.fromkeys(NODES, "conforming")
        assert "two nodes" not in nodes.said
        for node in ("LevelSkill", "MoveSkill"):
            assert any(
                node in line and "that the sender's certificate does not allow" in line
                for line in nodes.out
            ), nodes.said


def test_intruders_are_refused_and_the_run_goes_on(
    here: tuple[System, Path], tmp_path: Path
) -> None:
    attack(*here, free_endpoint().replace("tcp/", "tls/"), tmp_path, [()])


@pytest.mark.skipif(not may_be_made(), reason="only root may make network namespaces")
def test_intruders_are_refused_on_two_hosts(here: tuple[System, Path], tmp_path: Path) -> None:
    with two_hosts() as hosts:
        attack(*here, f"tls/{ADDRESSES[0]}:7447", tmp_path, hosts)


def test_a_stranger_that_tries_again_and_again_is_said_once(here: tuple[System, Path]) -> None:
    system, keys = here
    endpoint = free_endpoint().replace("tcp/", "tls/")
    host, _, port = endpoint.removeprefix("tls/").partition(":")
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    with contextlib.closing(
        Process("m2c", "run", system.path, "--secure", keys, "--endpoint", endpoint)
    ) as run:
        run.until(lambda: ticks(run) > 0)
        for _ in range(5):
            with (
                socket.create_connection((host, int(port))) as plain,
                contextlib.suppress(OSError),  # it is refused
                context.wrap_socket(plain) as stranger,
            ):
                assert stranger.recv(1) == b""
        before = ticks(run)
        run.until(lambda: ticks(run) > before + 5)
        assert run.end(signal.SIGINT) == 0, run.said
        said = [line for line in run.out if "zenoh" in line or "refused" in line]
        who = "somebody without a valid certificate of this system"
        assert said == [f"   m2c_run | refused a link to {who}: peer sent no certificates"]


def test_a_secured_run_of_an_example_is_conforming(tmp_path: Path) -> None:
    keys = init(tmp_path / "keys", CELL)
    endpoint = free_endpoint().replace("tcp/", "tls/")
    ticking = ("--ticks", 10, "--rate", 10, "--monitor")
    with contextlib.closing(
        Process("m2c", "run", CELL, "--secure", keys, "--endpoint", endpoint, *ticking)
    ) as run:
        assert run.end() == 0, run.said
        assert "0 violations" in run.said
        assert "4 machines: 4 conforming" in run.said
        assert "refused" not in run.said


def test_a_process_of_several_nodes_has_one_certificate(tmp_path: Path) -> None:
    system = System(tmp_path / "lab")
    deployment = (
        '<deployment><process name="brain"><node name="policy"/><node name="LevelSkill"/></process>'
        '<process name="arm"><node name="MoveSkill"/></process></deployment>'
    )
    system.path.write_text(system.path.read_text().replace("</roaml>", f"{deployment}</roaml>"))
    keys = init(tmp_path / "keys", system.path)
    secure = ("--secure", keys, "--endpoint", free_endpoint().replace("tcp/", "tls/"))
    with contextlib.closing(
        Process("m2c", "run", system.path, *secure, "--ticks", 30, "--monitor")
    ) as run:
        assert run.end() == 0, run.said
        assert "3 machines: 3 conforming until they ended" in run.said
        assert "refused" not in run.said
