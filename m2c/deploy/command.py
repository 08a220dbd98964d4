"""The ``m2c deploy`` command."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from m2c.inputs import Inputs, deployment_option, input_options, lenient_option
from m2c.terminal import fail, show


@click.command()
@click.option(
    "-o",
    "--output",
    required=True,
    type=click.Path(path_type=Path, file_okay=False),
    help="Folder of the deployment; made if it does not exist.",
)
@click.option("--transport", default="zenoh", show_default=True, help="Middleware of the nodes.")
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
@click.option("--force", is_flag=True, help="Overwrite files that were edited by hand.")
@lenient_option
@input_options
def deploy(
    inputs: Inputs,
    output: Path,
    transport: str,
    deployment: Path | None,
    endpoint: str,
    prefix: str,
    force: bool,
    lenient: bool,
) -> None:
    """Write what starts a system on the computers that run it.

    The folder gets the generated packages (`system`), a systemd unit for each host of the deployment
    (`systemd`), and a compose file with a container for each (`compose.yaml`, `Dockerfile`). Each runs
    `m2c run --host HOST`, which starts its part, waits for the others and starts again what dies.

    \b
    Example:
      m2c deploy examples/lab_tour/system.xml --deployment examples/lab_tour/deployment.xml \\
        --endpoint tcp/192.168.1.10:7447 -o deployed
    """
    import msgspec

    from m2c.check.reading import read_and_check
    from m2c.check.report import print_findings
    from m2c.codegen.generation import OtherPackagesError, write_system
    from m2c.codegen.writer import EditedFilesError, write_files
    from m2c.deploy.files import SYSTEM_FOLDER, DeployError, deployment_files
    from m2c.model import DiagnosticLog, ModelError
    from m2c.model.deployment import hosts_of, names_in_deployment, read_deployment_file
    from m2c.naming import naming_for

    naming = naming_for(transport)
    log = DiagnosticLog()
    system = read_and_check(*inputs, log, with_policy=False, naming=naming, lenient=lenient)
    if system is not None and deployment is not None:
        names = names_in_deployment(system.nodes, system.policy is not None)
        plan = read_deployment_file(deployment, names, log)
        system = msgspec.structs.replace(system, deployment=plan)
    print_findings(log.diagnostics)
    if system is None or log.has_errors:
        sys.exit(2)
    try:
        files = deployment_files(
            system.name,
            system.deployment,
            transport=transport,
            endpoint=endpoint,
            prefix=prefix,
        )
        write_system(system, output / SYSTEM_FOLDER, transport, None, naming, force)
        write_files(files, output, force)
    except EditedFilesError as error:
        fail(*error.lines)
    except (OtherPackagesError, DeployError) as error:
        fail(str(error))
    except ModelError as error:
        print_findings(error.diagnostics)
        sys.exit(2)
    except OSError as error:
        fail(f"cannot write {error.filename}: {error.strerror}")
    hosts = hosts_of(system.deployment)
    show(f"{system.name}: {', '.join(hosts) or 'one host'} in {output}")
    for name in sorted(files):
        show(f"  {name}")
