"""What works of Zenoh on this host (see :mod:`transports.diagnosis`)."""

# zenoh's stubs leave the results of some methods open
# mypy: disable-error-code="no-untyped-call"

from __future__ import annotations

import contextlib
import importlib
import os
import re
import socket
from collections.abc import Iterator, Mapping
from importlib.metadata import version
from pathlib import Path
from queue import Empty
from typing import TYPE_CHECKING, Any

from transports.diagnosis import Finding, State
from transports.interface import TransportError
from transports.options import DEFAULT_ENDPOINT, LAUNCHER, SECURE_ENDPOINT

if TYPE_CHECKING:
    import zenoh

WAIT_S = 5.0
"""How long two nodes of one host may take to find one another."""
_LOOPBACK = "127.0.0.1"
_READ = {"ZENOH_RUNTIME": "the threads of each session"}
"""The variables that a session of this project obeys."""
_OF_OTHERS = {
    "ZENOH_CONFIG": "give the file by --zenoh-config",
    "ZENOH_SESSION_CONFIG_URI": "rmw_zenoh reads it; here it is --zenoh-config",
    "ZENOH_ROUTER_CONFIG_URI": "rmw_zenoh's router reads it; here it is --zenoh-config",
    "ZENOH_CONFIG_OVERRIDE": "rmw_zenoh reads it; here it is --zenoh-config, --endpoint and --namespace",
    "ZENOH_ROUTER_CHECK_ATTEMPTS": "rmw_zenoh reads it; here it is --router",
}


def diagnose(options: Mapping[str, str]) -> Iterator[Finding]:
    """What is found of Zenoh: loopback, gossip, the endpoint, variables, certificates."""
    try:
        importlib.import_module("zenoh")
    except ImportError as error:
        mend = "pip install --force-reinstall eclipse-zenoh"
        yield Finding(State.WRONG, "zenoh", f"it cannot be imported: {error}", mend)
        return
    yield Finding(State.WORKS, "zenoh", f"eclipse-zenoh {version('eclipse-zenoh')}")
    yield from variables(os.environ)
    secure = options.get("secure", "")
    if secure:
        yield from certificates(Path(secure))
    broken = loopback()
    yield broken or Finding(State.WORKS, "loopback", f"{_LOOPBACK} can be reached")
    if broken is None:
        yield gossip()
        default = SECURE_ENDPOINT if secure else DEFAULT_ENDPOINT
        for endpoint in (options.get("endpoint") or default).split(","):
            if endpoint:
                yield at_endpoint(endpoint.strip(), options)


def variables(environment: Mapping[str, str]) -> Iterator[Finding]:
    """What each variable of ``environment`` that begins with ``ZENOH_`` does here."""
    for name in sorted(name for name in environment if name.startswith("ZENOH_")):
        shown = f"{name}={environment[name]}"
        if name in _READ:
            yield Finding(
                State.NOTE, "variable", f"{shown}: it sets {_READ[name]}", f"unset {name}"
            )
        else:
            mend = _OF_OTHERS.get(name, f"unset {name}")
            yield Finding(State.NOTE, "variable", f"{shown}: nothing here reads it", mend)


def certificates(folder: Path) -> Iterator[Finding]:
    """Whether each certificate in ``folder`` can be used now."""
    from transports.zenoh_link.credentials import check, expiry, names_in

    names = names_in(folder)
    if not names:
        text = f"{folder} has no certificates"
        yield Finding(State.WRONG, "certificate", text, f"moon keys init {folder} system.xml")
    for name in names:
        try:
            certificate = check(folder, name)
        except TransportError as error:
            text, _, mend = str(error).partition("; ")
            yield Finding(State.WRONG, "certificate", text, mend)
        else:
            yield Finding(
                State.WORKS, "certificate", f"{name}, which expires {expiry(certificate)}"
            )


def loopback() -> Finding | None:
    """Why this host cannot reach itself; None if it can."""
    try:
        with socket.create_server((_LOOPBACK, 0)) as server:
            socket.create_connection(server.getsockname(), WAIT_S).close()
    except OSError as error:
        text = (
            f"{_LOOPBACK} cannot be reached: {error.strerror or error}; no two nodes can meet here"
        )
        return Finding(State.WRONG, "loopback", text, "ip link set lo up")
    return None


def gossip() -> Finding:
    """Whether two nodes that meet at a third talk directly."""
    from transports.work_queue import WorkQueue
    from transports.zenoh_link.session import open_session

    key = f"m2c_doctor/{os.getpid()}"
    found: WorkQueue[bool] = WorkQueue()

    def matching(status: zenoh.MatchingStatus) -> None:
        if status.matching:
            found.put(True)

    with contextlib.ExitStack() as ended:
        try:
            endpoint = f"tcp/{_LOOPBACK}:{_free_port()}"
            ended.enter_context(open_session({"listen": endpoint}))
            one = ended.enter_context(open_session({"endpoint": endpoint}))
            other = ended.enter_context(open_session({"endpoint": endpoint}))
        except TransportError as error:
            return Finding(State.WRONG, "gossip", f"no session can be opened: {error}")
        received: WorkQueue[bool] = WorkQueue()
        other.declare_subscriber(key, lambda _: received.put(True))
        publisher = one.declare_publisher(key)
        publisher.declare_matching_listener(matching)
        status: Any = publisher.matching_status  # the stub says bool: it is none
        matching(status)
        with contextlib.suppress(Empty):
            found.get(WAIT_S)
            publisher.put(b"")
            received.get(WAIT_S)
            return Finding(State.WORKS, "gossip", "two nodes that met at a third talk directly")
    text = f"two nodes that met at a third did not find one another within {WAIT_S:g} s"
    return Finding(State.WRONG, "gossip", text, "m2c run --router: nodes need the router only")


def _free_port() -> int:
    with socket.create_server((_LOOPBACK, 0)) as server:
        port: int = server.getsockname()[1]
    return port


def at_endpoint(endpoint: str, options: Mapping[str, str]) -> Finding:
    """Who listens at ``endpoint``: a router, nodes, something else, or nobody."""
    from transports.zenoh_link.session import open_session

    protocol, _, rest = endpoint.partition("/")
    host, _, port = re.split("[?#]", rest, maxsplit=1)[0].rpartition(":")
    host = host.strip("[]")
    if not host or not (port.isascii() and port.isdecimal()) or int(port) > 65535:
        text = f"{endpoint!r} is not an endpoint"
        return Finding(State.WRONG, "endpoint", text, f"write one as {DEFAULT_ENDPOINT}")
    if protocol in ("tcp", "tls", "ws"):
        absent = _nobody(endpoint, host, int(port))
        if absent is not None:
            return absent
    asked = {**options, "endpoint": endpoint, "identity": LAUNCHER}
    try:
        with open_session(asked) as session:
            routers, peers = session.info.routers_zid(), session.info.peers_zid()
    except TransportError as error:
        text = f"something listens at {endpoint}, but no Zenoh session opens there: {error}"
        mend = f"ss -ltnp 'sport = :{port}' says who; --endpoint takes another"
        return Finding(State.WRONG, "endpoint", text, mend)
    if routers:
        return Finding(State.WORKS, "endpoint", f"a router is at {endpoint}")
    there = f"{len(peers)} process{'es' * (len(peers) != 1)} of Zenoh"
    return Finding(
        State.WORKS, "endpoint", f"no router is at {endpoint}; {there} can be reached there"
    )


def _nobody(endpoint: str, host: str, port: int) -> Finding | None:
    """That nobody listens at a TCP port, and whether this host may; None if somebody does."""
    try:
        socket.create_connection((host, port), WAIT_S).close()
    except (socket.gaierror, UnicodeError) as error:  # a name that no host can have
        text = f"{endpoint}: there is no host {host}: {getattr(error, 'strerror', error)}"
        return Finding(State.WRONG, "endpoint", text, f"getent hosts {host}")
    except OSError as error:
        refused = error.strerror or str(error)
    else:
        return None
    try:
        family, kind, number, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[
            0
        ]
        with socket.socket(family, kind, number) as server:
            server.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            server.bind(address)
    except PermissionError as error:
        text = f"{endpoint}: this process may not listen there: {error.strerror}"
        return Finding(State.WRONG, "endpoint", text, "--endpoint takes a port of 1024 or more")
    except OSError:
        text = f"{endpoint}, an address of another host, cannot be reached: {refused}"
        mend = f"m2c run system.xml --endpoint {endpoint}, on that host; is a firewall between?"
        return Finding(State.WRONG, "endpoint", text, mend)
    text = f"{endpoint} is free: the first command listens there; no router is running"
    return Finding(State.WORKS, "endpoint", text)
