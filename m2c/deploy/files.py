"""The files by which systemd or containers start a system: a unit and a container for each host.

Each runs ``m2c run``, which starts the processes that the deployment gives to its host, waits for those of
the others, and starts again what dies. They meet at an endpoint of the host that runs the policy.
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from typing import Any

import jinja2

from m2c.codegen.names import snake
from m2c.model.deployment import POLICY, Process, hosts_of

SYSTEM_FOLDER = "system"
"""Where the generated packages are, in the folder of the deployment."""
PORT = 7447
"""Where nodes meet on Zenoh, unless the user says otherwise."""
_ENDPOINT = re.compile(r"[a-z]{2,8}/[A-Za-z0-9._:\[\]-]{1,255}")
_PREFIX = re.compile(r"(/[A-Za-z0-9._-]+)+")


class DeployError(Exception):
    """The files cannot be made; the text says why and what would be right."""


def deployment_files(
    system: str,
    processes: Sequence[Process],
    *,
    transport: str = "zenoh",
    endpoint: str = "",
    prefix: str = "",
) -> dict[str, str]:
    """Relative path → content.

    Args:
        system: its name.
        processes: its deployment; without hosts all of it runs on one computer.
        transport: the middleware.
        endpoint: where the nodes meet on Zenoh; may be left out if there is one host.
        prefix: the folder on each computer that has the virtual environment ``venv`` and the generated
            packages ``system``; ``/opt/<system>`` by default.

    Raises:
        DeployError: an endpoint is needed, or one that was given is none.
    """
    name = snake(system) or "system"
    folder = prefix or f"/opt/{name}"
    if _PREFIX.fullmatch(folder) is None:
        raise DeployError(
            f"--prefix {folder}: expected an absolute path of letters, digits, `_`, `-` and `.`"
        )
    if endpoint and _ENDPOINT.fullmatch(endpoint) is None:
        raise DeployError(
            f"--endpoint {endpoint}: expected <protocol>/<address>, e.g. tcp/192.168.1.10:{PORT}"
        )
    hosts = hosts_of(processes) or [""]
    is_zenoh = transport == "zenoh"
    if len(hosts) > 1 and is_zenoh and not endpoint:
        raise DeployError(
            f"the nodes of {len(hosts)} hosts meet at an address that all of them reach: give --endpoint, "
            f"e.g. tcp/192.168.1.10:{PORT}, of {_meeting(processes, hosts)}"
        )
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("m2c.deploy"),
        undefined=jinja2.StrictUndefined,
        autoescape=False,
        trim_blocks=True,
        keep_trailing_newline=True,
    )
    files = {"Dockerfile": environment.get_template("Dockerfile.j2").render()}
    containers: list[dict[str, Any]] = []
    for host in hosts:
        nice = min((p.priority or 0 for p in processes if p.host == host), default=0)
        words = ["m2c", "run", SYSTEM_FOLDER, "--transport", transport, "--restart", "on-failure"]
        words += ["--quiet", *(["--host", host] if host else [])]
        at = ["--endpoint", endpoint] if endpoint else []
        facts = {"system": name, "host": host, "prefix": folder, "nice": nice}
        unit = f"{name}-{host}" if host else name
        files[f"systemd/{unit}.service"] = environment.get_template("service.j2").render(
            facts, command=[*words, *at]
        )
        meeting = _container(_meeting(processes, hosts) or name)
        inside = ["--endpoint", f"tcp/{meeting}:{PORT}"] if is_zenoh and host else []
        containers.append(
            {
                "service": _container(host or name),
                "nice": nice,
                "command": [json.dumps(word) for word in (*words, *inside)],
            }
        )
    files["compose.yaml"] = environment.get_template("compose.yaml.j2").render(
        system=name, hosts=containers
    )
    return files


def _meeting(processes: Sequence[Process], hosts: Sequence[str]) -> str:
    """The host where all meet: the policy's, which calls the others."""
    found = [process.host for process in processes if POLICY in process.nodes]
    return found[0] if found else hosts[0]


def _container(host: str) -> str:
    """A host's name as one of a container: lower case, no dots."""
    return host.lower().replace(".", "-").replace("_", "-")
