"""From options to an open Zenoh session.

Options (all strings, all optional):
    endpoint: comma-separated endpoints to connect to, e.g. ``tcp/192.168.1.10:7447``.
    rendezvous: an endpoint to listen on if nobody does yet, and to connect to otherwise: who comes first
        is where all the others meet.
    listen: comma-separated endpoints to listen on; by default a free port of the address by which this
        host reaches the endpoint: loopback if that is on loopback (see ``_reachable_at``).
    config: a Zenoh configuration file (JSON5): TLS, access control, routers, other modes.
    namespace: a prefix of all keys, so that several systems share one network.
    secure: a folder that `moon keys init` made: the configuration file there of this process is read instead
        of ``config``.
    identity: whose certificate in that folder is this process's; by default the node's.
    mode: ``peer`` (the default), ``client`` of the router at the endpoint, or ``router``, which only listens.

An option wins over the file; the file wins over the defaults: a peer without multicast scouting
that finds the other peers by gossip from those it connects to, and stamps what it publishes.
"""

# zenoh's stubs leave the results of some methods open
# mypy: disable-error-code="no-untyped-call"

from __future__ import annotations

import ipaddress
import json
import os
import re
import socket
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import zenoh

from transports.interface import TransportError, UnreachableError
from transports.options import MOST_NAMESPACE, NamespaceError, plain_namespace, refuse_unknown
from transports.zenoh_link.log import LOG

OPTIONS = (
    *("endpoint", "rendezvous", "listen", "config", "namespace", "secure", "identity"),
    "mode",
)
PEER, CLIENT, ROUTER = MODES = ("peer", "client", "router")
"""What a session is to the others, as Zenoh calls it."""

CONNECT_TIMEOUT_MS = 5_000
"""How long opening a session tries to reach its endpoints before it fails."""

_DEFAULTS: Mapping[str, object] = {
    "mode": PEER,
    "scouting/multicast/enabled": False,
    "scouting/gossip/enabled": True,
    "timestamping/enabled": True,
    "connect/exit_on_failure": True,
    "connect/retry": {
        "period_init_ms": 100,
        "period_max_ms": 1000,
        "period_increase_factor": 2,
    },
    "listen/exit_on_failure": True,
    # A reader that is stopped altogether may hold up who publishes to it for this long, once;
    # then its link is closed. (A reader that is only slow holds up nobody: see tap.py.)
    "transport/link/tx/queue/congestion_control/block/wait_before_close": 500_000,
}

_LOOPBACK = "tcp/127.0.0.1:0"
_ON_LOOPBACK = ("tcp/127.", "tcp/localhost", "tcp/[::1]", "tls/127.", "tls/localhost", "tls/[::1]")
_WITH_CERTIFICATE = ("tls/", "quic/")
"""Whoever listens there must have a certificate."""
_SECURE = "tls/"
_PROTOCOLS = ("tcp", "tls", "quic", "udp", "ws")
"""Zenoh's protocols whose endpoints are a host and a port."""

_THREADS = (
    "(rx: (worker_threads: 5), app: (handover: rx), acc: (handover: rx), net: (handover: rx))"
)
"""Zenoh's threads (``zenoh_runtime``), unless ``ZENOH_RUNTIME`` says otherwise. By default a message that
comes is noticed by one pool of threads and handled by another, as its link belongs to the pool that opened
it; here it is one pool, as large as those together: a tick wakes a third fewer threads. Sending keeps its own
thread, so that a receiver that waits for room in a queue cannot wait for itself."""

_ONE_CONNECTS = {"peer": {"to_router": "always", "to_peer": "greater-zid"}}
"""Which of two peers that learn of one another connects (``scouting/gossip/autoconnect_strategy``). By
default both do, and most pairs are left with two links. Only where each can be reached: who is behind a
firewall has to connect itself."""

_FILES = (
    *("transport/link/tls/root_ca_certificate", "transport/auth/usrpwd/dictionary_file"),
    *("transport/link/tls/listen_certificate", "transport/link/tls/listen_private_key"),
    *("transport/link/tls/connect_certificate", "transport/link/tls/connect_private_key"),
)
"""Settings that name a file. Zenoh says of one that is missing that it cannot connect."""

_RUST_PLACE = re.compile(r" at /\S+\.rs:\d+\.?")


class NotARouterError(TransportError):
    """Who is to be the client of a router has met a peer, which may not relay."""


def open_session(options: Mapping[str, str]) -> zenoh.Session:
    """An open session; TransportError says which option is wrong or what cannot be reached."""
    refuse_unknown("zenoh", options, OPTIONS)
    os.environ.setdefault("ZENOH_RUNTIME", _THREADS)  # read once, when the first session is opened
    zenoh.try_init_log_from_env()  # what Zenoh says itself, on standard output, if RUST_LOG asks for it
    if options.get("secure", ""):
        options = _with_certificate(options)
    rendezvous = options.get("rendezvous", "")
    return _open_at(rendezvous, options) if rendezvous else _open(options)


def _with_certificate(options: Mapping[str, str]) -> dict[str, str]:
    """``options`` that name the configuration file of this process in the folder of certificates."""
    from transports.zenoh_link.credentials import configuration_file

    if options.get("config", ""):
        raise TransportError("with certificates the configuration is the folder's; give no other")
    for option in ("endpoint", "rendezvous", "listen"):
        for endpoint in filter(None, options.get(option, "").split(",")):
            if not endpoint.strip().startswith(_SECURE):
                raise TransportError(
                    f"endpoint {endpoint!r}: with certificates it begins with {_SECURE}"
                )
    file = configuration_file(Path(options["secure"]), options.get("identity", ""))
    return {**options, "config": str(file)}


def _open_at(rendezvous: str, options: Mapping[str, str]) -> zenoh.Session:
    """Listen on ``rendezvous`` if that is possible; else somebody does, or it is another host's."""
    others = {name: value for name, value in options.items() if name != "rendezvous"}
    connecting = {**others, "endpoint": rendezvous}
    if _mode(configuration(connecting)) == CLIENT:  # which listens nowhere
        return _open(connecting)
    try:
        listening = configuration({**others, "listen": rendezvous})
        session = zenoh.open(listening)
    except zenoh.ZError as error:
        plain = _plain(str(error))
        if "listener" not in plain:
            raise _why_not_open(options, plain) from error
        try:
            return _open(connecting)
        except UnreachableError as unreachable:
            raise UnreachableError(
                f"{unreachable}; nor can this process listen there: {plain}"
            ) from None
    _warn_if_open_to_all(listening)
    return session


def _open(options: Mapping[str, str]) -> zenoh.Session:
    config = configuration(options)
    try:
        session = zenoh.open(config)
    except zenoh.ZError as error:
        raise _why_not_open(options, _plain(str(error))) from error
    if session.info.routers_zid():
        pass  # which relays: nobody needs to reach this process
    elif options.get("mode", "") == CLIENT:
        session.close()
        raise NotARouterError(
            f"what listens at {options.get('endpoint') or 'the endpoints of the configuration'} is a peer, "
            "not a router: are nodes running there without --router?"
        )
    else:
        _warn_if_half_reachable(config)
    if not options.get("endpoint", ""):  # else it is said where these processes meet
        _warn_if_open_to_all(config)
    return session


def _warn_if_open_to_all(config: zenoh.Config) -> None:
    """Who listens for other hosts, and asks nobody for a certificate, lets everybody in."""
    here = [e for e in _endpoints(config, "listen") if not e.startswith(_ON_LOOPBACK)]
    asks = json.loads(config.get_json("transport/link/tls"))["enable_mtls"]
    asks = asks and all(e.startswith(_WITH_CERTIFICATE) for e in here)
    if (
        here
        and _mode(config) != CLIENT  # which listens nowhere
        and not (asks and json.loads(config.get_json("access_control/enabled")))
    ):
        LOG.warning(
            "listening on %s without certificates and access control: whoever reaches this address can read "
            "everything, and publish, answer and call as any node; `moon keys` secures a system",
            ", ".join(here),
        )


def _warn_if_half_reachable(config: zenoh.Config) -> None:
    """Peers do not relay, as routers do: who listens on loopback only is not there for everybody."""
    away = [
        e for e in _endpoints(config, "connect") if not _listening_for(e).startswith(_ON_LOOPBACK)
    ]
    here = _endpoints(config, "listen")
    if away and here and all(e.startswith(_ON_LOOPBACK) for e in here):
        LOG.warning(
            "this node meets others at %s and listens on %s only: nodes of a third host cannot reach it; "
            "set listen/endpoints in a Zenoh configuration file to an address of this host, or run a router",
            ", ".join(away),
            ", ".join(here),
        )


def _mode(config: zenoh.Config) -> str:
    mode: str = json.loads(config.get_json("mode"))
    return mode


def _endpoints(config: zenoh.Config, key: str) -> list[str]:
    """What a peer of ``config`` connects to or listens on."""
    endpoints = json.loads(config.get_json(f"{key}/endpoints"))
    found = endpoints.get("peer", []) if isinstance(endpoints, dict) else endpoints
    return [found] if isinstance(found, str) else list(found or ())


def access_control(options: Mapping[str, str]) -> tuple[Any, str] | None:
    """The access control (Zenoh's configuration, as JSON) and the namespace of the session that ``options``
    ask for; None: they name no configuration.
    """
    if options.get("secure", ""):
        options = _with_certificate(options)
    if not options.get("config", ""):
        return None
    secure = options.get("secure", "")
    config = _read(Path(options["config"]), Path(secure) if secure else None)
    access = json.loads(config.get_json("access_control"))
    namespace = options.get("namespace", "") or json.loads(config.get_json("namespace"))
    return access, namespace or ""


def configuration(options: Mapping[str, str]) -> zenoh.Config:
    """The Zenoh configuration that ``options`` ask for."""
    path = options.get("config", "")
    secure = options.get("secure", "")
    config = _read(Path(path), Path(secure) if secure else None) if path else zenoh.Config()
    blank = zenoh.Config()
    for key, value in {**_DEFAULTS, "connect/timeout_ms": CONNECT_TIMEOUT_MS}.items():
        if not path or config.get_json(key) == blank.get_json(key):
            config.insert_json5(key, json.dumps(value))
    if mode := options.get("mode", ""):
        if mode not in MODES:
            raise TransportError(f"mode {mode!r}: it is one of {', '.join(MODES)}")
        config.insert_json5("mode", json.dumps(mode))
        if mode == ROUTER:  # a file may be that of the nodes, which meet here
            config.insert_json5("connect/endpoints", "[]")
    for option, key in (("endpoint", "connect/endpoints"), ("listen", "listen/endpoints")):
        endpoints = [e.strip() for e in options.get(option, "").split(",") if e.strip()]
        if endpoints:
            _set_endpoints(config, option, key, endpoints)
    if config.get_json("listen/endpoints") == blank.get_json("listen/endpoints"):
        reachable = json.dumps({"peer": _reachable_at(config)})
        config.insert_json5("listen/endpoints", reachable)
    strategy = "scouting/gossip/autoconnect_strategy"
    places = _endpoints(config, "connect") + _endpoints(config, "listen")
    is_default = config.get_json(strategy) == blank.get_json(strategy)
    if is_default and all(place.startswith(_ON_LOOPBACK) for place in places):
        config.insert_json5(strategy, json.dumps(_ONE_CONNECTS))
    if namespace := options.get("namespace", ""):
        if secure and json.loads(config.get_json("namespace")) != namespace:
            raise TransportError(
                f"namespace {namespace!r}: the certificates in {secure} are for another one, or for none; "
                "`moon keys init` takes --namespace, too"
            )
        try:
            zenoh.KeyExpr(namespace[:MOST_NAMESPACE])
            config.insert_json5("namespace", json.dumps(plain_namespace(namespace)))
        except zenoh.ZError as error:
            raise TransportError(f"namespace {namespace!r}: {_plain(str(error))}") from error
        except NamespaceError as error:
            raise TransportError(str(error)) from error
    return config


def _reachable_at(config: zenoh.Config) -> list[str]:
    """Where a peer listens if nobody says it: where those who meet it at its endpoints can reach it.

    Peers do not relay for one another, so each needs a link to each: nodes on loopback would be half there
    for those of another host. An endpoint on loopback keeps a system on its host.
    """
    may_listen = bool(json.loads(config.get_json("transport/link/tls"))["listen_certificate"])
    found = {_listening_for(endpoint) for endpoint in _endpoints(config, "connect")}
    found = {e for e in found if may_listen or not e.startswith(_WITH_CERTIFICATE)}
    return sorted(found) or [_LOOPBACK]


def _listening_for(endpoint: str) -> str:
    """Any port of the address from which this host reaches ``endpoint``, by the same protocol."""
    protocol, _, rest = endpoint.partition("/")
    host, _, port = re.split("[?#]", rest, maxsplit=1)[0].rpartition(":")
    if protocol not in _PROTOCOLS or not (port.isascii() and port.isdecimal()):
        return _LOOPBACK
    host = host.strip("[]")
    try:
        family, kind, _, _, address = socket.getaddrinfo(host, int(port), type=socket.SOCK_DGRAM)[0]
        with socket.socket(family, kind) as probe:
            probe.connect(address)  # sends nothing: it looks for the way
            here = ipaddress.ip_address(probe.getsockname()[0].partition("%")[0])
        there = ipaddress.ip_address(str(address[0]).partition("%")[0])
    except (OSError, UnicodeError):  # no such host, or no way there: opening says so
        return _LOOPBACK
    if there.is_unspecified:  # all addresses of this host
        here = there
    elif here.is_loopback and not endpoint.startswith(_WITH_CERTIFICATE):
        return _LOOPBACK
    return f"{protocol}/[{here}]:0" if here.version == 6 else f"{protocol}/{here}:0"


def _read(path: Path, folder: Path | None = None) -> zenoh.Config:
    """What ``path`` says; with ``folder``, of certificates, these are where it is now."""
    if not path.is_file():
        raise TransportError(f"there is no Zenoh configuration file {path}")
    try:
        config = zenoh.Config.from_file(path)
        if folder is not None:
            for place in _FILES:
                if (named := _named(config, place)) is not None:
                    config.insert_json5(place, json.dumps(str(folder / Path(named).name)))
    except zenoh.ZError as error:
        raise TransportError(f"{path}: {_plain(str(error))}") from error
    for place in _FILES:
        named = _named(config, place)
        if named is not None and not os.access(named, os.R_OK):
            why = "cannot be read" if os.path.exists(named) else "does not exist"
            raise TransportError(f"{path}: {place}: the file {named} {why}")
    return config


def _named(config: zenoh.Config, place: str) -> str | None:
    """The file that a setting names."""
    section, _, key = place.rpartition("/")
    found: str | None = json.loads(config.get_json(section))[key]
    return found


def _set_endpoints(config: zenoh.Config, option: str, key: str, endpoints: list[str]) -> None:
    for endpoint in endpoints:
        try:
            config.insert_json5(key, json.dumps([endpoint]))
        except zenoh.ZError as error:
            raise TransportError(
                f"{option} {endpoint!r} is not an endpoint; "
                "write <protocol>/<address>, e.g. tcp/127.0.0.1:7447"
            ) from error
    config.insert_json5(key, json.dumps(endpoints))


def _why_not_open(options: Mapping[str, str], plain: str) -> TransportError:
    if "connect" in plain.lower():
        certificates = ""
        if options.get("secure", ""):
            certificates = ", of the same authority"
        elif options.get("endpoint", "").startswith(_SECURE) and not options.get("config", ""):
            certificates = ", and does it take who has no certificate (--secure DIR)"
        return UnreachableError(
            f"cannot reach {options.get('endpoint') or 'the endpoints of the configuration'} "
            f"within {CONNECT_TIMEOUT_MS / 1000:g} s: is a node or router listening there{certificates}? "
            f"({plain})"
        )
    if "in use" in plain:
        return TransportError(
            f"cannot listen on {options.get('listen', '')}: the port is in use ({plain})"
        )
    return TransportError(f"cannot open a Zenoh session: {plain}")


def _plain(error: str) -> str:
    """Zenoh's message without the places in its source code."""
    return _RUST_PLACE.sub("", error).strip()
