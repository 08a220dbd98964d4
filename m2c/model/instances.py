"""Instances: one model as several nodes, each with a name, values and channels of its own.

``<input type="node-ascxml" src="GoTo.ascxml" name="GoToDock"><param name="poi" expr="3"/>
<remap from="/goal" to="/dock/goal"/></input>`` in a system file. What is left of the model is a machine
like any other, so nothing else knows of instances.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import msgspec

from m2c.diagnostics import DiagnosticLog, Position
from m2c.language.expressions import Expression
from m2c.language.parsing import parse_expression
from m2c.model.machine import Data, Interface, InterfaceKind, Machine
from m2c.model.naming import absolute
from m2c.model.structure import check_attributes, require
from m2c.model.walk import with_threads
from m2c.model.xml import Element
from m2c.suggestions import nearest

FILE = ("type", "src")
"""Attributes of an ``<input>``."""
INPUT = (*FILE, "name")
"""Attributes of one that is a model."""
_ATTRIBUTES = {"param": ("name", "expr"), "remap": ("from", "to")}


class Parameter(msgspec.Struct, frozen=True):
    """A value that a variable of the model begins with; ``position`` is that of its name."""

    name: str
    text: str
    value: Expression
    position: Position


class Remap(msgspec.Struct, frozen=True):
    """A channel of the model and the one that takes its place; ``position`` is that of the former."""

    channel: str
    by: str
    position: Position


class Instance(msgspec.Struct, frozen=True, kw_only=True):
    """A model that is read to be a node or a plugin.

    Attributes:
        path: of the model; the empty one if it is read already.
        position, element: of what names it.
        name: the machine's; "" if it is called as its model says.
        parameters: what variables begin with instead of what the model says.
        remaps: channels that take the place of the model's.
    """

    path: Path = Path()
    position: Position = Position("")
    element: str = ""
    name: str = ""
    parameters: tuple[Parameter, ...] = ()
    remaps: tuple[Remap, ...] = ()

    @property
    def is_stated(self) -> bool:
        """Whether something is said of the node beside its model, in a file: not on a command line."""
        is_changed = self.name or self.parameters or self.remaps
        return bool(self.position.file and is_changed)

    def is_like(self, other: Instance) -> bool:
        """Whether both are the same but for where they stand."""
        return _told(self) == _told(other)

    def of(self, machine: Machine, log: DiagnosticLog) -> Machine:
        """The machine that this makes of its model.

        The channels below the model's name, as ``/GoTo/tick`` of ``GoTo``, are below the instance's, unless
        they are remapped.

        Args:
            machine: the model's.
            log: where ``unknown-parameter`` goes, for a variable or a channel that the model does not have.
        """
        data = _with_values(machine, self.parameters, log)
        name = self.name or machine.name
        remaps = _known(machine, self.remaps, log)

        def renamed(interface: Interface) -> Interface:
            channel = _channel_of(interface)
            if channel is None:
                return interface
            remap = remaps.get(channel)
            if remap is not None:
                return msgspec.structs.replace(interface, channel=remap.by, position=remap.position)
            own = channel.removeprefix(f"/{machine.name}/")
            kept = channel if own == channel else f"/{name}/{own}"
            return msgspec.structs.replace(interface, channel=kept)

        def executing(thread: Machine) -> Machine:
            interfaces = tuple(map(renamed, thread.interfaces))
            return msgspec.structs.replace(thread, name=f"{name}Thread", interfaces=interfaces)

        return msgspec.structs.replace(
            machine,
            name=name,
            named_at=self.position if self.is_stated else machine.named_at,
            data=data,
            interfaces=tuple(map(renamed, machine.interfaces)),
            threads=tuple(
                msgspec.structs.replace(thread, machine=executing(thread.machine))
                for thread in machine.threads
            ),
        )


def as_they_are(paths: Iterable[Path]) -> tuple[Instance, ...]:
    """The models in ``paths``, called as they say."""
    return tuple(Instance(path=path, position=Position(str(path))) for path in paths)


def read_instance(path: Path, element: Element, log: DiagnosticLog) -> Instance:
    """What ``element``, an ``<input>``, makes of the model in ``path``.

    Faults go to ``log``: ``unknown-tag``, ``unknown-attribute``, ``missing-attribute``, ``bad-expression``,
    ``duplicate-parameter``.
    """
    parameters: dict[str, Parameter] = {}
    remaps: dict[str, Remap] = {}
    for child in element.children:
        if not _is_known(child, element, log):
            continue
        given, other = (require(child, name, log) for name in _ATTRIBUTES[child.tag])
        at = child.at(_ATTRIBUTES[child.tag][0])
        if not given or not other:
            continue
        given = absolute(given) if child.tag == "remap" else given
        if given in (remaps if child.tag == "remap" else parameters):
            log.error("duplicate-parameter", at, child.tag, f"`{given}` is given twice")
        elif child.tag == "remap":
            remaps[given] = Remap(given, absolute(other), at)
        else:
            value = parse_expression(other, child.at("expr"), child.tag, log)
            if value is not None:
                parameters[given] = Parameter(given, other, value, at)
    return Instance(
        path=path,
        position=element.at("name" if element.get("name") else "src"),
        element=element.tag,
        name=element.get("name"),
        parameters=tuple(parameters.values()),
        remaps=tuple(remaps.values()),
    )


def _is_known(child: Element, parent: Element, log: DiagnosticLog) -> bool:
    if child.tag not in _ATTRIBUTES:
        what, hint = f"not an element of <{parent.tag}>", nearest(child.tag, _ATTRIBUTES)
        log.error("unknown-tag", child.position, child.tag, what, hint)
        return False
    check_attributes(child, _ATTRIBUTES[child.tag], log)
    return True


def _told(instance: Instance) -> tuple[object, ...]:
    values = [(one.name, one.text) for one in instance.parameters]
    channels = [(one.channel, one.by) for one in instance.remaps]
    return (instance.path, instance.name, values, channels)


def _with_values(
    machine: Machine, parameters: Sequence[Parameter], log: DiagnosticLog
) -> tuple[Data, ...]:
    given = {one.name: one for one in parameters}
    for one in parameters:
        if all(data.name != one.name for data in machine.data):
            what = f"`{machine.name}` has no data `{one.name}`"
            hint = nearest(one.name, [data.name for data in machine.data])
            log.error("unknown-parameter", one.position, "param", what, hint)

    def begun(data: Data) -> Data:
        one = given.get(data.name)
        if one is None:
            return data
        return msgspec.structs.replace(
            data, initial=one.value, position=one.position, element="param"
        )

    return tuple(map(begun, machine.data))


def _known(machine: Machine, remaps: Sequence[Remap], log: DiagnosticLog) -> dict[str, Remap]:
    """Those of ``remaps`` whose channel the model has, by it."""
    channels = {_channel_of(item) for one in with_threads(machine) for item in one.interfaces}
    found = {}
    for remap in remaps:
        if remap.channel in channels:
            found[remap.channel] = remap
        else:
            what = f"`{machine.name}` has no channel `{remap.channel}`"
            hint = nearest(remap.channel, sorted(filter(None, channels)))
            log.error("unknown-parameter", remap.position, "remap", what, hint)
    return found


def _channel_of(interface: Interface) -> str | None:
    return None if interface.kind is InterfaceKind.TIMER else interface.channel
