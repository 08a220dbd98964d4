"""The options by which a command line's processes find their middleware."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"
"""Where the nodes of a system meet on Zenoh unless somebody says otherwise: of ``m2c run`` and what watches
the system, whoever comes first listens there.
"""


LAUNCHER = "m2c_run"
"""What `m2c run`'s own connection is called, and its certificate is for."""
SECURE_ENDPOINT = "tls/127.0.0.1:7447"
"""The same, with certificates."""


MOST_NAMESPACE = 255
"""Characters of a namespace: as of a node's name."""
_NOT_IN_A_NAMESPACE = "*$?#"
"""Zenoh's wildcards and separators: a namespace with a wildcard is many."""


class NamespaceError(ValueError):
    """A prefix of channels that is none; the text says why and what would be right."""


def plain_namespace(text: str) -> str:
    """``text`` as the prefix of all channels of one system: chunks with ``/`` between them, or "".

    Raises:
        NamespaceError: it is none.
    """
    chunks = text.split("/")
    bad = next((c for c in text if c in _NOT_IN_A_NAMESPACE or not c.isprintable()), "")
    wrong = ""
    if bad:
        wrong = f"{bad!r} is not allowed in it"
    elif text and "" in chunks:
        wrong = "it has an empty chunk, or a slash at an end"
    elif any(chunk.startswith("@") for chunk in chunks):
        wrong = "a chunk may not start with '@'"
    elif text != text.strip() or any(chunk != chunk.strip() for chunk in chunks):
        wrong = "a chunk may not begin or end with a space"
    elif len(text) > MOST_NAMESPACE:
        wrong = f"it has more than {MOST_NAMESPACE} characters"
    if wrong:
        shown = text if len(text) <= MOST_NAMESPACE else f"{text[:MOST_NAMESPACE]}…"
        raise NamespaceError(
            f"namespace {shown!r}: {wrong}; write chunks with '/' between them, e.g. robots/7"
        )
    return text


def refuse_unknown(transport: str, options: Iterable[str], known: Iterable[str]) -> None:
    """Raise TransportError if ``options`` has a name that is not among ``known``, those of ``transport``."""
    from transports.interface import TransportError  # a command's --help needs no messages

    unknown = sorted(set(options) - set(known))
    if "args" in unknown:
        raise TransportError(
            f"--ros-args is for ros2, not {transport}; the prefix of channels is --namespace, and `m2c run` "
            "has --param and --remap on every transport"
        )
    if unknown:
        raise TransportError(
            f"the {transport} transport has no option {unknown[0]!r}; it has {', '.join(known)}"
        )


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
