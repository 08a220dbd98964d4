"""Writing the folder of certificates and Zenoh configurations that every process is started with."""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from cryptography import x509
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric import ec

from moon.keys.certificates import Pair, issued, new_authority
from transports.options import SECURE_ENDPOINT
from transports.zenoh.access import Rights, Role, access_control
from transports.zenoh_link.credentials import (
    AUTHORITY,
    AUTHORITY_KEY,
    CERTIFICATE,
    CONFIGURATION,
    KEY,
)

_FOR_ITS_USER = 0o600
_FOR_ALL = 0o644


class KeysError(Exception):
    """The folder cannot be made or renewed; the text says why."""


def make(
    folder: Path, system: str, processes: Sequence[Rights], days: int, namespace: str = ""
) -> None:
    """Write a new authority, and a certificate and a configuration for each of ``processes``.

    Args:
        folder: is made; or it is there, and empty.
        system: the system's name, which the authority has in its own.
        processes: what each may do.
        days: how long the certificates are valid.
        namespace: the prefix of all keys.

    Raises:
        KeysError: there is something in ``folder``.
        OSError: it cannot be written.
    """
    if folder.exists() and not folder.is_dir():
        raise KeysError(f"{folder}: not a folder")
    if folder.is_dir() and any(folder.iterdir()):
        raise KeysError(
            f"{folder} is not empty: certificates are not written over; `moon keys renew` makes new "
            "ones of the same authority"
        )
    authority = new_authority(f"authority of {system}")
    files = {
        AUTHORITY: (authority.certificate_pem(), _FOR_ALL),
        AUTHORITY_KEY: (authority.key_pem(), _FOR_ITS_USER),
        **_issued(folder, authority, processes, days, namespace),
    }
    made = [parent for parent in (folder, *folder.parents) if not parent.exists()]
    folder.mkdir(parents=True, exist_ok=True)
    try:
        _write(folder, files)
    except OSError:
        for parent in made:
            parent.rmdir()
        raise


def renew(folder: Path, processes: Sequence[Rights], days: int, namespace: str = "") -> None:
    """Write new certificates and configurations, of the authority in ``folder``; see :func:`make`.

    Raises:
        KeysError: there is no authority in ``folder``, or it cannot be used.
        OSError: a file cannot be written.
    """
    _write(folder, _issued(folder, _authority_in(folder), processes, days, namespace))


def _authority_in(folder: Path) -> Pair:
    try:
        certificate = x509.load_pem_x509_certificate((folder / AUTHORITY).read_bytes())
        key_bytes = (folder / AUTHORITY_KEY).read_bytes()
        key = serialization.load_pem_private_key(key_bytes, password=None)
    except OSError as error:
        raise KeysError(
            f"{error.filename}: {error.strerror}; `moon keys init` makes an authority"
        ) from error
    except (ValueError, TypeError) as error:
        raise KeysError(f"{folder}: the authority cannot be read: {error}") from error
    if not isinstance(key, ec.EllipticCurvePrivateKey):
        raise KeysError(f"{folder / AUTHORITY_KEY}: not a key that `moon keys init` made")
    if key.public_key() != certificate.public_key():
        raise KeysError(f"{folder / AUTHORITY_KEY}: not the key of {AUTHORITY}")
    return Pair(certificate, key)


def _issued(
    folder: Path, authority: Pair, processes: Sequence[Rights], days: int, namespace: str
) -> dict[str, tuple[bytes, int]]:
    """The files of ``processes`` by name, with their modes; nothing is written."""
    access = access_control(processes, namespace)
    files: dict[str, tuple[bytes, int]] = {}
    for process in processes:
        pair = issued(authority, process.name, days)
        text = json.dumps(_configuration(folder, process, access, namespace), indent=1)
        head = f"// Zenoh, for {process.name}; written by `moon keys`\n"
        files |= {
            f"{process.name}{CERTIFICATE}": (pair.certificate_pem(), _FOR_ALL),
            f"{process.name}{KEY}": (pair.key_pem(), _FOR_ITS_USER),
            f"{process.name}{CONFIGURATION}": (f"{head}{text}\n".encode(), _FOR_ALL),
        }
    return files


def _configuration(
    folder: Path, process: Rights, access: dict[str, Any], namespace: str
) -> dict[str, Any]:
    """The Zenoh configuration of ``process``; whoever starts it says where the others are met."""
    place = folder.resolve()
    certificate = str(place / f"{process.name}{CERTIFICATE}")
    key = str(place / f"{process.name}{KEY}")
    is_router = process.role is Role.ROUTER
    configuration: dict[str, Any] = {"mode": "router" if is_router else "peer"}
    if is_router:
        port = SECURE_ENDPOINT.rpartition(":")[2]
        configuration["listen"] = {"endpoints": [f"tls/[::]:{port}"]}
    elif namespace:
        configuration["namespace"] = namespace
    configuration |= {
        "scouting": {"multicast": {"enabled": False}},
        "transport": {
            "link": {
                "protocols": ["tls"],
                "tls": {
                    "root_ca_certificate": str(place / AUTHORITY),
                    "listen_certificate": certificate,
                    "listen_private_key": key,
                    "connect_certificate": certificate,
                    "connect_private_key": key,
                    "enable_mtls": True,
                    # who somebody is, the certificate's name says, wherever it runs
                    "verify_name_on_connect": False,
                    "close_link_on_expiration": True,
                },
            }
        },
        "access_control": access,
    }
    return configuration


def _write(folder: Path, files: Mapping[str, tuple[bytes, int]]) -> None:
    """Write all of ``files``, or none: they come to their places when the last has been written.

    None has another mode than its own at any moment.
    """
    staged = Path(tempfile.mkdtemp(prefix=".new-", dir=folder))
    try:
        for name, (contents, mode) in files.items():
            descriptor = os.open(staged / name, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode)
            with os.fdopen(descriptor, "wb") as out:
                out.write(contents)
        for name in files:
            (staged / name).replace(folder / name)
    finally:
        shutil.rmtree(staged)
