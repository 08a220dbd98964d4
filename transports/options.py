"""The options by which a command line's processes find their middleware."""

from __future__ import annotations

from collections.abc import Sequence

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"
"""Where the nodes of a system meet on Zenoh unless somebody says otherwise: of ``m2c run`` and what watches
the system, whoever comes first listens there.
"""


LAUNCHER = "m2c_run"
"""What `m2c run`'s own connection is called, and its certificate is for."""
SECURE_ENDPOINT = "tls/127.0.0.1:7447"
"""The same, with certificates."""


def transport_options(
    endpoints: Sequence[str],
    config: str,
    namespace: str,
    secure: str = "",
    identity: str = "",
    router: bool = False,
) -> dict[str, str]:
    """What ``transports.registry.connect`` takes: the options that are given, by their names.

    Args:
        endpoints: where to connect; none leaves that to the configuration or the middleware.
        config: a Zenoh configuration file, or "".
        namespace: prefix of every channel, or "".
        secure: the folder of certificates, or "".
        identity: whose certificate there is taken, or "" for the node's.
        router: whether a Zenoh router is at the endpoints, through which everything goes.
    """
    options = {
        "endpoint": ",".join(endpoints),
        "config": config,
        "namespace": namespace,
        "secure": secure,
        "identity": identity,
        "mode": "client" if router else "",
    }
    return {name: value for name, value in options.items() if value}


def meeting_at(options: dict[str, str]) -> dict[str, str]:
    """``options`` of a process on Zenoh that listens where it is to connect, if nobody does yet."""
    return {"rendezvous" if name == "endpoint" else name: options[name] for name in options}
