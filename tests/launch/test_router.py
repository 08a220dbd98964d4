"""``m2c run --router``: all talk through a router, whoever has started it."""

from __future__ import annotations

import contextlib
import os
import select
import signal
import socket
from pathlib import Path

import pytest

from benchmarks.family import family, links
from tests.keys.test_secure_runs import init
from tests.launch.system import Run, System
from tests.launch.test_run import router
from tests.monitor.processes import WAIT_S, Monitor, Process, free_endpoint

pytestmark = [pytest.mark.zenoh]

NOMINAL = "3 machines: 3 conforming"


def router_of(run: Run) -> int:
    """The process of the run's router."""
    (found,) = [
        pid
        for pid in family(run.process.pid)
        if b"transports.zenoh_link.router" in Path(f"/proc/{pid}/cmdline").read_bytes()
    ]
    return found


def test_a_run_starts_a_router_to_which_each_process_has_its_only_link(system: System) -> None:
    endpoint = free_endpoint()
    run = Run(system.path, "--router", "--processes", "each", endpoint=endpoint)
    run.until("Move ..")
    assert "starting 2 nodes at the router " + endpoint in run.output
    assert f"router | INFO transports.zenoh: a router listens at {endpoint}" in run.output
    processes = family(run.process.pid)
    assert len(processes) == 5  # the launcher, two nodes, the policy and the router
    assert links(processes) == 4
    of_router = router_of(run)
    run.process.send_signal(signal.SIGINT)
    assert run.end() == 0, run.output
    assert run.lines[-1].endswith("all nodes have ended")
    assert not Path(f"/proc/{of_router}").exists()


def test_a_run_through_its_router_is_heard_from_its_first_act_and_conforming(
    system: System, tmp_path: Path
) -> None:
    recording = tmp_path / "run.mcap"
    run = Run(system.path, "--router", "--ticks", 50, "--monitor", "--record", recording)
    assert run.end() == 0, run.output
    assert NOMINAL in run.output
    assert "0 violations" in run.output
    assert "middle" not in run.output
    assert "not linked to this tap" not in run.output
    assert recording.stat().st_size


def test_a_router_that_is_there_is_used_by_several_runs_and_goes_on(system: System) -> None:
    endpoint = free_endpoint()
    with router(endpoint), contextlib.closing(Monitor(system.path, "--endpoint", endpoint)) as moon:
        moon.until_listening()
        parts = [Run(system.path, "--router", "--only", "MoveSkill", endpoint=endpoint)]
        parts[0].until("1 node is up")
        rest = ("--router", "--without", "MoveSkill", "--ticks", 3)
        parts.append(Run(system.path, *rest, endpoint=endpoint))
        assert parts[1].end() == 0, parts[1].output
        parts[0].process.send_signal(signal.SIGINT)
        assert parts[0].end() == 0, parts[0].output
        assert moon.end(signal.SIGINT) == 0, moon.said
        for part in parts:
            assert "router |" not in part.output
    outcomes = {found["machine"]: found["verdict"] for found in moon.summary["machines"]}
    assert outcomes == dict.fromkeys(("LevelSkill", "MoveSkill", "policy"), "conforming")


def test_a_tap_that_comes_later_is_linked_to_all_nodes_by_the_router(system: System) -> None:
    endpoint = free_endpoint()
    run = Run(system.path, "--router", "--processes", "each", endpoint=endpoint)
    run.until("Move ..")
    with contextlib.closing(Process("moon", "tap", "--json", "--endpoint", endpoint)) as tap:
        for node in ("LevelSkill", "MoveSkill"):
            answer = f'"kind":"response","channel":"/{node}/tick","source":"{node}"'
            tap.until(lambda answer=answer: answer in tap.said)
        assert tap.end(signal.SIGINT) == 0, tap.said
    assert "warning" not in tap.said
    assert "not linked" not in tap.said


def test_a_peer_where_a_router_is_expected_is_one_error(system: System) -> None:
    endpoint = free_endpoint()
    mesh = Run(system.path, endpoint=endpoint)
    mesh.until("tick ")
    run = Run(system.path, "--router", "--processes", "each", endpoint=endpoint)
    assert run.end() == 2, run.output
    assert run.lines == [
        f"error: what listens at {endpoint} is a peer, not a router: are nodes running there without "
        "--router?"
    ]
    mesh.process.send_signal(signal.SIGINT)
    assert mesh.end() == 0, mesh.output


def test_a_port_that_something_else_has_is_one_error(system: System) -> None:
    with contextlib.closing(socket.create_server(("127.0.0.1", 0))) as taken:
        endpoint = f"tcp/127.0.0.1:{taken.getsockname()[1]}"
        run = Run(system.path, "--router", "--processes", "each", endpoint=endpoint)
        assert run.end() == 2
    (line,) = run.lines
    assert line.startswith(f"error: cannot reach {endpoint} within 5 s: is a node or router ")
    assert f"nor can a router be started there: cannot listen on {endpoint}: the port is" in line


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_a_router_that_ends_is_named_and_everything_is_stopped(
    system: System, number: signal.Signals
) -> None:
    run = Run(system.path, "--router", "--restart", "on-failure")
    run.until("Move ..")
    os.kill(router_of(run), number)
    assert run.end() == 1, run.output
    how = "exited with code 0" if number is signal.SIGTERM else f"was killed by {number.name}"
    assert f"router {how}; everything was stopped. Its last lines:" in run.output
    assert run.output.count(how) == 1


def test_a_router_does_not_outlive_a_run_that_is_killed(system: System) -> None:
    run = Run(system.path, "--router")
    run.until("Move ..")
    of_router = os.pidfd_open(router_of(run))
    try:
        run.process.kill()
        ended, _, _ = select.select([of_router], [], [], WAIT_S)
        assert ended
    finally:
        os.close(of_router)
        run.end()


def test_a_secured_run_goes_through_a_router_with_its_own_certificate(
    system: System, tmp_path: Path
) -> None:
    keys = init(tmp_path / "keys", system.path)
    endpoint = free_endpoint().replace("tcp/", "tls/")
    secured = ("--router", "--secure", keys, "--ticks", 5, "--monitor")
    run = Run(system.path, *secured, endpoint=endpoint)
    assert run.end() == 0, run.output
    assert NOMINAL in run.output
    assert "refused" not in run.output
    (keys / "router.pem").unlink()
    run = Run(system.path, "--router", "--secure", keys, endpoint=endpoint)
    assert run.end() == 2, run.output
    assert f"nor can a router be started there: {keys} has no certificate of router" in run.output


def test_a_configuration_file_needs_the_routers_endpoint_beside_it(system: System) -> None:
    config = system.folder / "zenoh.json5"
    config.write_text("{}")
    run = Run(system.path, "--router", "--zenoh-config", config, endpoint=None)
    assert run.end() == 2
    assert run.lines == [
        "error: --router: with --zenoh-config give --endpoint, too: where the router is"
    ]
    run = Run(system.path, "--router", "--zenoh-config", config, "--ticks", 2)
    assert run.end() == 0, run.output


def test_a_router_is_for_zenoh_only(system: System) -> None:
    run = Run(system.path, "--router", "--transport", "simulated", endpoint=None)
    assert run.end() == 2
    assert run.lines == ["error: --transport simulated: --router is for a middleware"]
