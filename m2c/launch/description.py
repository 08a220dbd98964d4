"""``launch.json``: what a generated system consists of."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from pathlib import Path

import msgspec

from m2c.model.deployment import Process
from m2c.policy.program import Policy
from m2c.suggestions import nearest

FILE = "launch.json"
FORMAT = 1
POLICY_FILE = "policy.json"
_PYTHON = ".py"
NODE_CLASS = "NODE_CLASS"
"""What a node's module calls its class."""
_CLASS = re.compile(rf"^{NODE_CLASS}\b", re.MULTILINE)


class Package(msgspec.Struct, frozen=True):
    """A generated package: the node's name, its Python package, its folder."""

    name: str
    package: str
    path: str

    @property
    def is_replacement(self) -> bool:
        """Whether something else than the system's own package runs in a node's place."""
        return os.path.isabs(self.path)

    @property
    def is_module(self) -> bool:
        """Whether it is a Python file in a node's place, which need not run the node by itself."""
        return self.is_replacement and (Path(self.path) / f"{self.package}{_PYTHON}").is_file()


class LaunchDescription(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The nodes of a system and its policy; ``called`` are the nodes that a tick reaches by calls,
    ``deployment`` is what the system file says of its processes, and ``channels`` are those that models name.
    """

    format: int
    system: str
    tick_rate_hz: float
    nodes: tuple[Package, ...]
    policy: Package | None = None
    called: tuple[str, ...] = ()
    deployment: tuple[Process, ...] = ()
    channels: tuple[str, ...] = ()


class LaunchError(Exception):
    """The system cannot be run; the text says why and what would be right."""


def read_description(folder: Path) -> LaunchDescription:
    """Read ``folder/launch.json``.

    Raises:
        LaunchError: it is not there, or not of this version.
    """
    path = folder / FILE
    try:
        description = msgspec.json.decode(path.read_bytes(), type=LaunchDescription)
    except OSError as error:
        raise LaunchError(f"{path}: {error.strerror}; make it with `m2c generate`") from error
    except msgspec.MsgspecError as error:
        raise LaunchError(f"{path}: {error}; generate the system again") from error
    if description.format != FORMAT:
        raise LaunchError(
            f"{path}: format {description.format}, this m2c reads {FORMAT}; generate the system again"
        )
    return description


def read_policy_of(description: LaunchDescription, folder: Path) -> Policy | None:
    """The policy that ``description`` runs, if any.

    Raises:
        LaunchError: it cannot be read.
    """
    package = description.policy
    if package is None:
        return None
    path = folder / package.path / package.package / POLICY_FILE
    try:
        return msgspec.json.decode(path.read_bytes(), type=Policy)
    except OSError as error:
        raise LaunchError(f"{path}: {error.strerror}; generate the system again") from error
    except msgspec.MsgspecError as error:
        raise LaunchError(f"{path}: {error}; generate the system again") from error


def select(
    description: LaunchDescription, only: tuple[str, ...], without: tuple[str, ...]
) -> LaunchDescription:
    """``description`` with some nodes; the policy counts as a node called ``policy``.

    Raises:
        LaunchError: a name is not one of the system.
    """
    names = [node.name for node in description.nodes]
    if description.policy is not None:
        names.append(description.policy.name)
    kept = selected(description.system, names, only, without)
    nodes = tuple(node for node in description.nodes if node.name in kept)
    policy = description.policy
    if policy is not None and policy.name not in kept:
        policy = None
    return msgspec.structs.replace(description, nodes=nodes, policy=policy)


def selected(
    system: str, names: Sequence[str], only: tuple[str, ...], without: tuple[str, ...]
) -> list[str]:
    """Those of ``names`` that are to be run of ``system``.

    Raises:
        LaunchError: another name was chosen.
    """
    for name in (*only, *without):
        if name not in names:
            raise LaunchError(f"{system} has no node {name}; {nearest(name, names)}")
    return [name for name in names if (not only or name in only) and name not in without]


def replace(
    description: LaunchDescription, folder: Path, replacements: dict[str, Path]
) -> LaunchDescription:
    """``description`` with generated packages in place of some nodes.

    Raises:
        LaunchError: no such node, or the folder is not a generated package.
    """
    nodes = {node.name: node for node in description.nodes}
    for name, path in replacements.items():
        if name not in nodes:
            raise LaunchError(f"{description.system} has no node {name}; {nearest(name, nodes)}")
        folder = path if path.is_dir() else path.parent
        nodes[name] = Package(name, package_in(path), str(folder.resolve()))
    return msgspec.structs.replace(description, nodes=tuple(nodes.values()))


def is_code(path: Path) -> bool:
    """Whether what is to run in a node's place is a package or a Python file, not a model."""
    return path.is_dir() or path.suffix == _PYTHON


def package_in(path: Path) -> str:
    """The Python package in the folder ``path``, or the module that the file is.

    Raises:
        LaunchError: there is none.
    """
    if path.suffix == _PYTHON and path.is_file():
        if not path.stem.isidentifier():
            raise LaunchError(f"{path}: not a name of a Python module; use letters, digits and _")
        if not _CLASS.search(path.read_text(encoding="utf-8", errors="replace")):
            raise LaunchError(f"{path}: it has no {NODE_CLASS}; end it with {NODE_CLASS} = …")
        return path.stem
    inner = [item.parent.name for item in sorted(path.glob("*/__main__.py"))]
    if len(inner) != 1:
        raise LaunchError(f"{path}: not a generated package; expected <package>/__main__.py in it")
    return inner[0]
