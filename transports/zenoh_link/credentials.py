"""The folder that ``moon keys init`` makes, as a process finds its certificate and configuration in it.

``ca.pem``; and for each process ``<name>.pem``, ``<name>.key`` and ``<name>.json5``. A process needs its own
three and ``ca.pem``.
"""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

from cryptography import x509
from cryptography.exceptions import InvalidSignature, UnsupportedAlgorithm
from cryptography.hazmat.primitives import serialization
from cryptography.x509.oid import NameOID

from transports.interface import TransportError
from transports.zenoh_link.log import LOG

AUTHORITY = "ca.pem"
AUTHORITY_KEY = "ca.key"
SUFFIXES = CERTIFICATE, KEY, CONFIGURATION = (".pem", ".key", ".json5")
SOON_DAYS = 30
"""A certificate that expires within so many days is warned of."""
_OTHERS = 0o077
_MAKE = "`moon keys init` makes one"
_RENEW = "`moon keys renew` makes new ones"


def configuration_file(folder: Path, name: str) -> Path:
    """The Zenoh configuration of the process ``name`` in ``folder``, whose certificate is good.

    One that expires soon, and a key that others can read, are warned of.

    Args:
        folder: made by ``moon keys init``.
        name: of the process; what its certificate is for.

    Raises:
        TransportError: as of :func:`check`.
    """
    certificate = check(folder, name)
    if (certificate.not_valid_after_utc - datetime.now(UTC)).days < SOON_DAYS:
        LOG.warning("the certificate of %s expires %s; %s", name, expiry(certificate), _RENEW)
    key = folder / f"{name}{KEY}"
    if key.stat().st_mode & _OTHERS:
        LOG.warning("%s can be read by others: chmod 600", key)
    return folder / f"{name}{CONFIGURATION}"


def check(folder: Path, name: str) -> x509.Certificate:
    """The certificate of the process ``name`` in ``folder``, which it can be run with now.

    Raises:
        TransportError: there is no such folder or file, it cannot be read, or the certificate is not valid
            now, is for another name, is not the authority's or not of the key.
    """
    if not folder.is_dir():
        what = "is not a folder" if folder.exists() else "does not exist"
        raise TransportError(f"{folder} {what}: no certificates; {_MAKE}")
    certificate_file = folder / f"{name}{CERTIFICATE}"
    if not certificate_file.exists():
        raise TransportError(f"{folder} has no certificate of {name}; {_has(folder)}; {_RENEW}")
    authority = _certificate(folder / AUTHORITY)
    certificate = _certificate(certificate_file)
    _check(certificate_file, certificate, name)
    try:
        certificate.verify_directly_issued_by(authority)
    except (ValueError, TypeError, InvalidSignature) as error:
        raise TransportError(
            f"{certificate_file}: not issued by the authority in {folder / AUTHORITY}; {_RENEW}"
        ) from error
    _check_key(folder / f"{name}{KEY}", certificate)
    configuration = folder / f"{name}{CONFIGURATION}"
    if not configuration.exists():
        raise TransportError(f"{configuration} does not exist; {_RENEW}")
    return certificate


def names_in(folder: Path) -> list[str]:
    """Those for whom there is a certificate in ``folder``, sorted."""
    return sorted(file.stem for file in folder.glob(f"*{CERTIFICATE}") if file.name != AUTHORITY)


def expiry(certificate: x509.Certificate) -> str:
    """When a certificate expires, in words: ``on 2027-01-31, in 12 days``."""
    until = certificate.not_valid_after_utc
    days = (until - datetime.now(UTC)).days
    return f"on {until:%Y-%m-%d}, in {days} day{'s' * (days != 1)}"


def _has(folder: Path) -> str:
    names = names_in(folder)
    return f"it has those of {', '.join(names)}" if names else "it has none"


def _read(file: Path) -> bytes:
    try:
        return file.read_bytes()
    except OSError as error:
        raise TransportError(f"{file}: cannot be read: {error.strerror}") from error


def _certificate(file: Path) -> x509.Certificate:
    try:
        return x509.load_pem_x509_certificate(_read(file))
    except ValueError as error:
        raise TransportError(f"{file}: not a certificate (PEM); {_RENEW}") from error


def _check(file: Path, certificate: x509.Certificate, name: str) -> None:
    names = certificate.subject.get_attributes_for_oid(NameOID.COMMON_NAME)
    found = str(names[0].value) if names else "nobody"
    if found != name:
        raise TransportError(f"{file}: a certificate for another name, {found} instead of {name}")
    now = datetime.now(UTC)
    if certificate.not_valid_after_utc <= now:
        on = f"{certificate.not_valid_after_utc:%Y-%m-%d %H:%M} UTC"
        raise TransportError(f"{file}: the certificate of {name} expired on {on}; {_RENEW}")
    if certificate.not_valid_before_utc > now:
        on = f"{certificate.not_valid_before_utc:%Y-%m-%d %H:%M} UTC"
        raise TransportError(
            f"{file}: the certificate of {name} is valid from {on} on; is the clock right?"
        )


def _check_key(file: Path, certificate: x509.Certificate) -> None:
    try:
        key = serialization.load_pem_private_key(_read(file), password=None)
    except (ValueError, TypeError, UnsupportedAlgorithm) as error:
        raise TransportError(f"{file}: not a private key (PEM, not encrypted); {_RENEW}") from error
    if key.public_key() != certificate.public_key():
        raise TransportError(f"{file}: not the key of the certificate beside it; {_RENEW}")
