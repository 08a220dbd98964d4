"""The files by which systemd or containers start a system: a unit and a container for each host.

Each runs ``m2c run``, which starts the processes that the deployment gives to its host, waits for those of
the others, and starts again what dies. They meet at an endpoint of the host that runs the policy.
"""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Sequence
from typing import Any

import jinja2
import msgspec
from ruamel.yaml import YAML
from ruamel.yaml.scalarstring import DoubleQuotedScalarString

from m2c.codegen.names import snake
from m2c.model.deployment import POLICY, Process, hosts_of
from transports.descriptions import described

SYSTEM_FOLDER = "system"
"""Where the generated packages are, in the folder of the deployment."""
UNITS_FOLDER = "systemd"
"""Where the hosts' units are, in the folder of the deployment."""
KEYS_FOLDER = "keys"
"""Where the certificates of each host are, in the folder of the deployment; on a host, its own are there."""
PORT = 7447
"""Where nodes meet on Zenoh, unless the user says otherwise."""
USER = "m2c"
"""Whose the processes of a unit are, unless the user says otherwise."""
_ENDPOINT = re.compile(r"[a-z]{2,8}/[A-Za-z0-9._:\[\]-]{1,255}")
_PREFIX = re.compile(r"(/[A-Za-z0-9._-]+)+")
_USER = re.compile(r"[a-z_][a-z0-9_-]{0,30}")
"""What useradd(8) takes everywhere."""
_WHEEL = re.compile(r"[A-Za-z0-9_.+!-]{1,200}\.whl")
_ASK_FOR_WHEEL = (
    "${M2C:?set M2C to what pip installs as m2c: ./NAME.whl of a wheel in this folder, or an address; "
    "or deploy with --wheel}"
)
_IN_CONTAINERS = f"/{KEYS_FOLDER}"


class DeployError(Exception):
    """The files cannot be made; the text says why and what would be right."""


class Hosting(msgspec.Struct, frozen=True, kw_only=True):
    """How the hosts run their part of a system.

    Attributes:
        transport: the middleware.
        endpoint: where the nodes meet on Zenoh; may be left out if there is one host.
        prefix: the folder on each computer that has the virtual environment ``venv``, the generated
            packages ``system`` and, with ``secure``, the host's ``keys``; ``/opt/<system>`` by default.
        user: whose the processes are under systemd.
        wheel: the name of the wheel that containers install m2c from, beside the files; "": whoever builds
            them says what is installed.
        namespace: the prefix of every channel.
        secure: whether the processes run with certificates.
    """

    transport: str = "zenoh"
    endpoint: str = ""
    prefix: str = ""
    user: str = USER
    wheel: str = ""
    namespace: str = ""
    secure: bool = False


def deployment_files(
    system: str, processes: Sequence[Process], hosting: Hosting | None = None
) -> dict[str, str]:
    """Relative path → content.

    Args:
        system: its name.
        processes: its deployment; without hosts all of it runs on one computer.
        hosting: how the hosts run it; by default as ``Hosting()`` says.

    Raises:
        DeployError: an endpoint is needed, or what was given is none, no folder, no user or no wheel.
    """
    hosting = hosting or Hosting()
    endpoint, wheel, secure = hosting.endpoint, hosting.wheel, hosting.secure
    name = snake(system) or "system"
    folder = hosting.prefix or f"/opt/{name}"
    protocol = "tls" if secure else "tcp"
    _check(folder, endpoint, hosting.user, wheel, protocol if secure else "")
    hosts = hosts_of(processes) or [""]
    has_endpoints = described(hosting.transport).has_endpoints
    if len(hosts) > 1 and has_endpoints and not endpoint:
        raise DeployError(
            f"the nodes of {len(hosts)} hosts meet at an address that all of them reach: give --endpoint, "
            f"e.g. {protocol}/192.168.1.10:{PORT}, of {_meeting(processes, hosts)}"
        )
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("m2c.deploy"),
        undefined=jinja2.StrictUndefined,
        autoescape=False,
        trim_blocks=True,
        keep_trailing_newline=True,
    )
    files = {"Dockerfile": environment.get_template("Dockerfile.j2").render(wheel=wheel)}
    if secure:
        files[".dockerignore"] = f"{KEYS_FOLDER}\n"  # no image has keys
    units = host_labels(hosts)
    containers = _distinct(hosts, lambda host: _container(host or name))
    meeting = containers[_meeting(processes, hosts)]
    services: dict[str, Any] = {}
    for host in hosts:
        nice = min((p.priority or 0 for p in processes if p.host == host), default=0)
        words = ["m2c", "run", SYSTEM_FOLDER, "--transport", hosting.transport]
        words += ["--restart", "on-failure", "--quiet", *(["--host", host] if host else [])]
        words += ["--namespace", hosting.namespace] if hosting.namespace else []
        here = ["--secure", f"{folder}/{KEYS_FOLDER}"] if secure else []
        here += ["--endpoint", endpoint] if endpoint else []
        facts = {"system": name, "host": host, "prefix": folder, "nice": nice, "user": hosting.user}
        unit = f"{name}-{units[host]}" if host else name
        files[f"{UNITS_FOLDER}/{unit}.service"] = environment.get_template("service.j2").render(
            facts, command=[*words, *here]
        )
        inside = ["--secure", _IN_CONTAINERS] if secure else []
        inside += ["--endpoint", f"{protocol}/{meeting}:{PORT}"] if has_endpoints and host else []
        services[containers[host]] = _service(
            containers[host],
            [*words, *inside],
            wheel,
            nice,
            f"./{KEYS_FOLDER}/{units[host] or name}" if secure else "",
        )
    title = f"# Written by m2c deploy: {name}, a container for each host.\n"
    files["compose.yaml"] = title + _yaml({"services": services})
    return files


def host_labels(hosts: Sequence[str]) -> dict[str, str]:
    """What files of each host are called: distinct also where upper and lower case are not."""
    return _distinct(hosts, lambda host: host)


def _check(folder: str, endpoint: str, user: str, wheel: str, protocol: str) -> None:
    """DeployError if one of them cannot stand in a unit or a Dockerfile; ``protocol``: of the endpoint."""
    if _PREFIX.fullmatch(folder) is None:
        raise DeployError(
            f"--prefix {folder}: expected an absolute path of letters, digits, `_`, `-` and `.`"
        )
    if endpoint and _ENDPOINT.fullmatch(endpoint) is None:
        raise DeployError(
            f"--endpoint {endpoint}: expected <protocol>/<address>, e.g. tcp/192.168.1.10:{PORT}"
        )
    if endpoint and protocol and not endpoint.startswith(f"{protocol}/"):
        raise DeployError(f"--endpoint {endpoint}: with certificates it begins with {protocol}/")
    if _USER.fullmatch(user) is None:
        raise DeployError(
            f"--user {user}: expected a user's name: lower case letters, digits, `_` and `-`, at most 31"
        )
    if wheel and _WHEEL.fullmatch(wheel) is None:
        raise DeployError(f"--wheel {wheel}: expected the file of a wheel, NAME.whl")


def _service(name: str, command: Sequence[str], wheel: str, nice: int, keys: str) -> dict[str, Any]:
    service: dict[str, Any] = {
        "build": {"context": ".", "args": {"M2C": f"./{wheel}" if wheel else _ASK_FOR_WHEEL}},
        "hostname": name,
        "command": list(command),
        "restart": "on-failure",
        "init": True,
        "stop_grace_period": "30s",
    }
    if keys:
        service["volumes"] = [f"{keys}:{_IN_CONTAINERS}:ro"]
    if nice < 0:
        service["cap_add"] = ["SYS_NICE"]
    return service


def _yaml(data: Any) -> str:
    """``data`` with every string in quotes: to YAML a plain ``1``, ``null`` or ``yes`` is something else."""
    yaml = YAML()
    yaml.width = 2**16
    yaml.indent(mapping=2, sequence=4, offset=2)
    text = io.StringIO()
    yaml.dump(_quoted(data), text)
    return text.getvalue()


def _quoted(data: Any) -> Any:
    match data:
        case str():
            return DoubleQuotedScalarString(data)
        case dict():
            return {_quoted(key): _quoted(value) for key, value in data.items()}
        case list():
            return [_quoted(item) for item in data]
    return data


def _distinct(hosts: Sequence[str], form: Callable[[str], str]) -> dict[str, str]:
    """``form`` of each host's name; with a number where another's differs in nothing but case."""
    wanted = {form(host).casefold() for host in hosts}
    labels: dict[str, str] = {}
    taken: set[str] = set()
    for host in hosts:
        label, number = form(host), 1
        while label.casefold() in taken or (number > 1 and label.casefold() in wanted):
            number += 1
            label = f"{form(host)}-{number}"
        taken.add(label.casefold())
        labels[host] = label
    return labels


def _meeting(processes: Sequence[Process], hosts: Sequence[str]) -> str:
    """The host where all meet: the policy's, which calls the others."""
    found = [process.host for process in processes if POLICY in process.nodes]
    return found[0] if found else hosts[0]


def _container(host: str) -> str:
    """A host's name as one of a container, which DNS can have: lower case, no dots."""
    return re.sub(r"[._-]+", "-", host.lower()).strip("-")
