"""The certificates of a deployment: each host gets those of the processes that run there, and no others."""

from __future__ import annotations

import os
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path

from m2c.model.deployment import Process
from transports.options import LAUNCHER
from transports.zenoh_link.credentials import AUTHORITY, KEY, SUFFIXES, check

_FOR_ITS_USER = 0o600
_FOR_ALL = 0o644


def certified(
    folder: Path, processes: Sequence[Process], names: Sequence[str], hosts: Sequence[str]
) -> dict[str, list[str]]:
    """The certificates in ``folder`` that each host needs: of its processes, and of ``m2c run`` itself.

    Args:
        folder: made by ``moon keys init``.
        processes: the deployment; empty: each of ``names`` has a process.
        names: of the nodes, and of the policy.
        hosts: of the deployment; "" for a computer without a name.

    Raises:
        TransportError: a process has no certificate that is good now.
    """
    found = {
        host: [LAUNCHER, *(p.name for p in processes if p.host == host)]
        if processes
        else [LAUNCHER, *names]
        for host in hosts
    }
    for name in dict.fromkeys(name for of_host in found.values() for name in of_host):
        check(folder, name)
    return found


def write_keys(folder: Path, output: Path, certificates: Mapping[str, Sequence[str]]) -> None:
    """Copy certificates, keys and configurations from ``folder``; what is no longer to be there goes.

    Args:
        folder: as of :func:`certified`.
        output: gets a folder for each host.
        certificates: names, by the name of the host's folder.

    Raises:
        OSError: a file cannot be read or written.
    """
    for host, names in certificates.items():
        place = output / host
        place.mkdir(parents=True, exist_ok=True)
        wanted = [AUTHORITY, *(f"{name}{suffix}" for name in names for suffix in SUFFIXES)]
        for file in place.iterdir():
            if file.suffix in SUFFIXES and file.name not in wanted:
                file.unlink()
        for name in wanted:
            _copy(folder / name, place / name, _FOR_ITS_USER if name.endswith(KEY) else _FOR_ALL)


def _copy(source: Path, target: Path, mode: int) -> None:
    """Copy into a file that has no other mode at any moment."""
    new = target.with_name(f".{target.name}.new")
    new.unlink(missing_ok=True)
    descriptor = os.open(new, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode)
    with os.fdopen(descriptor, "wb") as out, source.open("rb") as contents:
        shutil.copyfileobj(contents, out)
    new.replace(target)
