"""From options to an open Zenoh session.

Options (all strings, all optional):
    endpoint: comma-separated endpoints to connect to, e.g. ``tcp/192.168.1.10:7447``.
    listen: comma-separated endpoints to listen on; default ``tcp/127.0.0.1:0``.
    config: a Zenoh configuration file (JSON5): TLS, access control, routers, other modes.
    namespace: a prefix of all keys, so that several systems share one network.

An option wins over the file; the file wins over the defaults: a peer without multicast scouting
that finds the other peers by gossip from those it connects to, and stamps what it publishes.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Mapping
from pathlib import Path

import zenoh

from transports.interface import TransportError

OPTIONS = ("endpoint", "listen", "config", "namespace")

CONNECT_TIMEOUT_MS = 5_000
"""How long opening a session tries to reach its endpoints before it fails."""

_DEFAULTS: Mapping[str, object] = {
    "mode": "peer",
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

_THREADS = (
    "(rx: (worker_threads: 5), app: (handover: rx), acc: (handover: rx), net: (handover: rx))"
)
"""Zenoh's threads (``zenoh_runtime``), unless ``ZENOH_RUNTIME`` says otherwise. By default a message that
comes is noticed by one pool of threads and handled by another, as its link belongs to the pool that opened
it; here it is one pool, as large as those together: a tick wakes a third fewer threads. Sending keeps its own
thread, so that a receiver that waits for room in a queue cannot wait for itself."""

_RUST_PLACE = re.compile(r" at /\S+\.rs:\d+\.?")


def open_session(options: Mapping[str, str]) -> zenoh.Session:
    """An open session; TransportError says which option is wrong or what cannot be reached."""
    unknown = sorted(set(options) - set(OPTIONS))
    if unknown:
        raise TransportError(
            f"the zenoh transport has no option {unknown[0]!r}; it has {', '.join(OPTIONS)}"
        )
    config = configuration(options)
    os.environ.setdefault("ZENOH_RUNTIME", _THREADS)  # read once, when the first session is opened
    try:
        return zenoh.open(config)
    except zenoh.ZError as error:
        raise TransportError(_why_not_open(options, str(error))) from error


def configuration(options: Mapping[str, str]) -> zenoh.Config:
    """The Zenoh configuration that ``options`` ask for."""
    path = options.get("config", "")
    config = _read(Path(path)) if path else zenoh.Config()
    blank = zenoh.Config()
    for key, value in {**_DEFAULTS, "connect/timeout_ms": CONNECT_TIMEOUT_MS}.items():
        if not path or config.get_json(key) == blank.get_json(key):
            config.insert_json5(key, json.dumps(value))
    for option, key in (("endpoint", "connect/endpoints"), ("listen", "listen/endpoints")):
        endpoints = [e.strip() for e in options.get(option, "").split(",") if e.strip()]
        if endpoints:
            _set_endpoints(config, option, key, endpoints)
    if config.get_json("listen/endpoints") == blank.get_json("listen/endpoints"):
        config.insert_json5("listen/endpoints", '{"peer": ["tcp/127.0.0.1:0"]}')
    if namespace := options.get("namespace", "").strip("/"):
        try:
            zenoh.KeyExpr(namespace)
            config.insert_json5("namespace", json.dumps(namespace))
        except zenoh.ZError as error:
            raise TransportError(f"namespace {namespace!r}: {_plain(str(error))}") from error
    return config


def _read(path: Path) -> zenoh.Config:
    if not path.is_file():
        raise TransportError(f"there is no Zenoh configuration file {path}")
    try:
        return zenoh.Config.from_file(path)
    except zenoh.ZError as error:
        raise TransportError(f"{path}: {_plain(str(error))}") from error


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


def _why_not_open(options: Mapping[str, str], error: str) -> str:
    plain = _plain(error)
    if "connect" in plain.lower():
        return (
            f"cannot reach {options.get('endpoint') or 'the endpoints of the configuration'} "
            f"within {CONNECT_TIMEOUT_MS / 1000:g} s: is a node or router listening there? ({plain})"
        )
    if "in use" in plain:
        return f"cannot listen on {options.get('listen', '')}: the port is in use ({plain})"
    return f"cannot open a Zenoh session: {plain}"


def _plain(error: str) -> str:
    """Zenoh's message without the places in its source code."""
    return _RUST_PLACE.sub("", error).strip()
