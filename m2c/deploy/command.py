"""The ``m2c deploy`` command."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path
from typing import NamedTuple

import click

from m2c.changes import Changes
from m2c.inputs import (
    ExistingPath,
    Inputs,
    TransportName,
    change_options,
    deployment_option,
    input_options,
    options_as,
)
from m2c.terminal import fail, show


class DeployOptions(NamedTuple):  # msgspec's would cost each --help its import
    """The command line of ``m2c deploy``; what was not given is None, "" or False.

    Attributes:
        inputs: the system, and folders of interface packages.
        output: the folder of the deployment.
        transport: the middleware of the nodes.
        deployment: the file of the deployment.
        endpoint: where the nodes of several hosts meet on Zenoh.
        prefix: the folder on each computer.
        user: whose the processes are under systemd.
        wheel: what containers install m2c from.
        namespace: prefix of every channel.
        secure: the folder of certificates.
        force: whether files that were edited are overwritten.
        changes: how the models are changed.
    """

    inputs: Inputs
    output: Path
    transport: str
    deployment: Path | None
    endpoint: str
    prefix: str
    user: str
    wheel: Path | None
    namespace: str
    secure: Path | None
    force: bool
    changes: Changes


@click.command()
@click.option(
    "-o",
    "--output",
    required=True,
    type=click.Path(path_type=Path, file_okay=False),
    help="Folder of the deployment; made if it does not exist.",
)
@click.option(
    "--transport",
    type=TransportName(),
    default="zenoh",
    show_default=True,
    help="Middleware of the nodes.",
)
@deployment_option
@click.option(
    "--endpoint",
    default="",
    help="Zenoh: where the nodes of several hosts meet: an address of the host that runs the policy.",
)
@click.option(
    "--prefix",
    default="",
    help="Folder on each computer: its `venv` has m2c, its `system` the packages.  "
    "[default: /opt/<system>]",
)
@click.option(
    "--user",
    default="m2c",
    show_default=True,
    help="Whose the processes are under systemd; made with `useradd --system`.",
)
@click.option(
    "--wheel",
    type=ExistingPath(path_type=Path, exists=True, dir_okay=False),
    metavar="FILE",
    help="The wheel that containers install m2c from; it is copied. Without it, set M2C to build them.",
)
@click.option("--namespace", default="", help="Prefix of every channel.")
@click.option(
    "--secure",
    type=click.Path(path_type=Path),
    metavar="DIR",
    help="Zenoh: run with the certificates that `moon keys init` made in DIR; each host gets its own only.",
)
@click.option("--force", is_flag=True, help="Overwrite files that were edited by hand.")
@change_options
@input_options
@options_as(DeployOptions)
def deploy(options: DeployOptions) -> None:
    """Write what starts a system on the computers that run it.

    The folder gets the generated packages (`system`), a systemd unit for each host of the deployment
    (`systemd`), and a compose file with a container for each (`compose.yaml`, `Dockerfile`). Each runs
    `m2c run --host HOST`, which starts its part, waits for the others and starts again what dies. With
    --secure there are the certificates of each host, too (`keys`).

    \b
    Example:
      m2c deploy examples/lab_tour/system.xml --deployment examples/lab_tour/deployment.xml \\
        --endpoint tcp/192.168.1.10:7447 -o deployed
    """
    import msgspec

    from m2c.check.reading import read_and_check
    from m2c.check.report import print_findings
    from m2c.codegen.generation import OtherPackagesError, write_system
    from m2c.codegen.names import snake
    from m2c.codegen.writer import EditedFilesError, remove_outdated, write_files
    from m2c.deploy.files import (
        KEYS_FOLDER,
        SYSTEM_FOLDER,
        UNITS_FOLDER,
        DeployError,
        Hosting,
        deployment_files,
        host_labels,
    )
    from m2c.model import DiagnosticLog, ModelError
    from m2c.model.deployment import hosts_of, names_in_deployment, read_deployment_file
    from m2c.naming import naming_for
    from transports.descriptions import described
    from transports.interface import TransportError
    from transports.options import NamespaceError, plain_namespace

    output, transport, namespace = options.output, options.transport, options.namespace
    wheel, secure = options.wheel, options.secure
    if secure is not None and not described(transport).has_endpoints:
        raise click.UsageError("--secure is for zenoh")
    if secure is not None and namespace:
        raise click.UsageError("--namespace: the certificates say it; give it to `moon keys init`")
    try:
        plain_namespace(namespace)
    except NamespaceError as error:
        fail(f"--namespace: {error}")
    naming = naming_for(transport)
    log = DiagnosticLog()
    system = read_and_check(
        *options.inputs, log, with_policy=False, naming=naming, changes=options.changes
    )
    if system is not None and options.deployment is not None:
        names = names_in_deployment(system.nodes, system.policy is not None)
        plan = read_deployment_file(options.deployment, names, log)
        system = msgspec.structs.replace(system, deployment=plan)
    print_findings(log.diagnostics)
    if system is None or log.has_errors:
        sys.exit(2)
    try:
        hosting = Hosting(
            transport=transport,
            endpoint=options.endpoint,
            prefix=options.prefix,
            user=options.user,
            wheel="" if wheel is None else wheel.name,
            namespace=namespace,
            secure=secure is not None,
        )
        files = deployment_files(system.name, system.deployment, hosting)
        hosts = hosts_of(system.deployment)
        certificates = {}
        if secure is not None:
            from m2c.deploy.keys import certified, write_keys

            names = names_in_deployment(system.nodes, system.policy is not None)
            of_hosts = certified(secure, system.deployment, names, hosts or [""])
            labels = host_labels(hosts) if hosts else {"": snake(system.name) or "system"}
            certificates = {labels[host]: found for host, found in of_hosts.items()}
        write_system(system, output / SYSTEM_FOLDER, transport, None, naming, options.force)
        write_files(files, output, options.force)
        outdated = remove_outdated(files, output, UNITS_FOLDER)
        if secure is not None:
            write_keys(secure, output / KEYS_FOLDER, certificates)
        if wheel is not None:
            shutil.copyfile(wheel, output / wheel.name)
    except EditedFilesError as error:
        fail(*error.lines)
    except (OtherPackagesError, DeployError, TransportError) as error:
        fail(str(error))
    except ModelError as error:
        print_findings(error.diagnostics)
        sys.exit(2)
    except OSError as error:
        fail(f"cannot write {error.filename}: {error.strerror}")
    show(f"{system.name}: {', '.join(hosts) or 'one host'} in {output}")
    for name in sorted(files):
        show(f"  {name}")
    for name in outdated:
        show(f"  {name}, of an earlier deployment, is removed")
    for host, names in certificates.items():
        show(f"  {KEYS_FOLDER}/{host}: {', '.join(names)}")
