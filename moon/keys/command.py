"""The ``moon keys`` commands."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

import click

from m2c.inputs import IntegerRange, interface_folders
from m2c.lazy_group import LazyGroup
from m2c.terminal import fail, say

if TYPE_CHECKING:
    from transports.zenoh.access import Rights

_COMMANDS = {
    "init": ("moon.keys.command:init", "Make an authority, certificates and configurations."),
    "renew": ("moon.keys.command:renew", "Make new certificates of the same authority."),
}
DAYS = 365


@click.group(cls=LazyGroup, lazy_commands=_COMMANDS)
def keys() -> None:
    """Secure a system on Zenoh: certificates, and what each process may do with its own.

    `m2c run`, nodes and the commands of `moon` take the folder with --secure. All links are encrypted then,
    whoever has no certificate is not let in, and each process may declare and send only what its models
    say. The observer may only listen. See docs/security.md.

    \b
    Example:
      moon keys init keys examples/lab_tour/system.xml
      m2c run examples/lab_tour/system.xml --secure keys
      moon tap --secure keys
    """


def _arguments(command: Callable[..., None]) -> Callable[..., None]:
    for decorator in reversed(
        (
            click.argument("folder", type=click.Path(path_type=Path), metavar="DIR"),
            click.argument("system", type=click.Path(path_type=Path)),
            interface_folders,
            click.option(
                "--days",
                type=IntegerRange(min=1, max=3650),
                default=DAYS,
                show_default=True,
                help="How long the certificates are valid.",
            ),
            click.option("--namespace", default="", help="Prefix of every channel."),
        )
    ):
        command = decorator(command)
    return command


@click.command()
@_arguments
def init(
    folder: Path, system: Path, interfaces: tuple[Path, ...], days: int, namespace: str
) -> None:
    """Make DIR: a certificate authority, and a certificate and a configuration for each process.

    The processes are the nodes of SYSTEM, its policy, `m2c_run` (which starts them), `monitor`, `observer`
    (what else listens) and `router`. Private keys can be read by their user only. A process needs ca.pem
    and the files of its own name; ca.key makes certificates, and no process needs it.

    \b
    Example:
      moon keys init keys examples/lab_tour/system.xml
    """
    from moon.keys.folder import KeysError, make
    from transports.interface import TransportError

    prefix = _plain(namespace)
    name, processes = _read(system, interfaces)
    try:
        make(folder, name, processes, days, prefix)
    except (KeysError, TransportError, OSError) as error:
        _fail(error)
    _report(folder, processes)


@click.command()
@_arguments
def renew(
    folder: Path, system: Path, interfaces: tuple[Path, ...], days: int, namespace: str
) -> None:
    """Make new certificates and configurations in DIR, by the authority that is there.

    For certificates that expire, and after models have changed. Processes that run go on with what they
    have read, until their certificates expire; start them again.

    \b
    Example:
      moon keys renew keys examples/lab_tour/system.xml
    """
    from moon.keys.folder import KeysError
    from moon.keys.folder import renew as make_again
    from transports.interface import TransportError

    prefix = _plain(namespace)
    _, processes = _read(system, interfaces)
    try:
        make_again(folder, processes, days, prefix)
    except (KeysError, TransportError, OSError) as error:
        _fail(error)
    _report(folder, processes)


def _read(system: Path, interfaces: tuple[Path, ...]) -> tuple[str, tuple[Rights, ...]]:
    """The system's name, and what its processes may do; ends the process if the models are no good."""
    import sys

    from m2c.model import ModelError
    from m2c.model.paths import meant
    from moon.keys.rights import RightsError, rights_of
    from moon.monitor.reading import read_checked, say_why

    if not system.exists():
        fail(f"{system}: no such file or folder; {meant(system) or 'expected a system file'}")
    try:
        read = read_checked([system], interfaces)
        return read.name, rights_of(read)
    except ModelError as error:
        say_why(error)
        sys.exit(2)
    except RightsError as error:
        fail(f"{system}: {error}")


def _plain(namespace: str) -> str:
    """``namespace``, checked: it becomes a part of every right."""
    from transports.options import NamespaceError, plain_namespace

    try:
        return plain_namespace(namespace)
    except NamespaceError as error:
        fail(f"--namespace: {error}")


def _fail(error: Exception) -> NoReturn:
    if isinstance(error, OSError):
        fail(f"{error.filename}: {error.strerror}")
    fail(str(error))


def _report(folder: Path, processes: tuple[Rights, ...]) -> None:
    from cryptography import x509

    from transports.zenoh_link.credentials import AUTHORITY_KEY, CERTIFICATE, expiry

    first = (folder / f"{processes[0].name}{CERTIFICATE}").read_bytes()
    until = expiry(x509.load_pem_x509_certificate(first))
    say(
        f"{folder}: certificates for {', '.join(process.name for process in processes)}",
        f"they expire {until}",
        f"keep {folder / AUTHORITY_KEY} away from robots: it makes certificates, and no process needs it",
    )
