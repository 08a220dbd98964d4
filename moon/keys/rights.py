"""What each process of a system may declare and send, as its models say."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence

from m2c.diagnostics import DiagnosticLog
from m2c.model.machine import Interface, InterfaceKind, Machine
from m2c.model.system import System
from m2c.model.walk import with_threads
from m2c.policy.program import Policy, read_policy
from m2c.policy.ticks import TICKS_CHANNEL
from m2c.printable import printable
from moon.connection import MONITOR, OBSERVER
from moon.feed.places import places_of
from moon.keys.certificates import MOST_NAME
from moon.monitor.status import POLICY
from moon.sinks.topic import VERDICTS_CHANNEL
from transports.actions.parts import channel_of_part
from transports.interface import ObservationKind
from transports.options import LAUNCHER
from transports.zenoh.access import Rights, Role

ROUTER = "router"
OTHERS = (POLICY, LAUNCHER, MONITOR, OBSERVER, ROUTER)
"""Processes that are no nodes of the system: the policy, ``m2c run`` itself, ``moon monitor``, the other
commands of ``moon``, and a router."""

_TAKEN = (*OTHERS, "ca")
_SEPARATOR = "/"


class RightsError(Exception):
    """The rights of a process cannot be known; the text says why."""


class _Channels:
    """Collects what one process has."""

    def __init__(self) -> None:
        self.does: defaultdict[ObservationKind, dict[str, None]] = defaultdict(dict)
        """On which channels it does what is observed so."""
        self.keeps_last: set[str] = set()

    def add(self, interface: Interface, channel: str) -> None:
        for (place, kind), _ in places_of(interface, channel):
            self.does[kind][place] = None
        if interface.kind is InterfaceKind.ACTION_SERVER:
            self.keeps_last.add(channel_of_part(channel, "status"))
        if interface.transient_local:
            self.keeps_last.add(channel)

    def rights(self, name: str, role: Role) -> Rights:
        return Rights(
            name=name,
            role=role,
            publishes=tuple(self.does[ObservationKind.MESSAGE]),
            subscribes=tuple(self.does[ObservationKind.MESSAGE_TAKEN]),
            serves=tuple(self.does[ObservationKind.RESPONSE_SENT]),
            calls=tuple(self.does[ObservationKind.REQUEST_SENT]),
            keeps_last=frozenset(self.keeps_last),
        )


def rights_of(system: System) -> tuple[Rights, ...]:
    """What each process of ``system`` may do: each node alone, those of the deployment, :data:`OTHERS`.

    Args:
        system: checked models.

    Raises:
        RightsError: a node's name cannot be that of its certificate, or a plugin's channel is known only
            when the system runs.
        ModelError: the policy cannot be read.
    """
    nodes = []
    for machine in system.nodes:
        if machine.name in _TAKEN:
            raise RightsError(
                f"a node is named {machine.name}: `moon keys` has another certificate of that name; give "
                "the node another one"
            )
        _check_name("node", machine.name)
        channels = _Channels()
        for interface in _interfaces(machine):
            if interface.channel is not None:
                channels.add(interface, interface.channel)
        nodes.append(channels.rights(machine.name, Role.NODE))
    own = (*nodes, *_policy(system))
    return (
        *own,
        *_shared(system, [rights.name for rights in own]),
        Rights(name=LAUNCHER, role=Role.LAUNCHER),
        Rights(name=MONITOR, role=Role.OBSERVER, publishes=(VERDICTS_CHANNEL,)),
        Rights(name=OBSERVER, role=Role.OBSERVER),
        Rights(name=ROUTER, role=Role.ROUTER),
    )


def _check_name(what: str, name: str) -> None:
    """Whether a certificate and its files can be called by it; RightsError if not."""
    is_long = len(name.encode()) > MOST_NAME
    if is_long or _SEPARATOR in name or name.startswith(".") or not name.isprintable():
        raise RightsError(
            f"the {what} name {printable(name)!r} cannot be that of a certificate and its files: it has at "
            f"most {MOST_NAME} bytes in UTF-8, is printable, has no '{_SEPARATOR}', and begins with no '.'"
        )


def _shared(system: System, names: Sequence[str]) -> Iterable[Rights]:
    """The processes of the system's deployment in which there are several nodes, or one of another name."""
    for process in system.deployment:
        if process.nodes == (process.name,):
            continue
        if process.name in (*names, *_TAKEN):
            raise RightsError(
                f"a process of the deployment is named {process.name}: there is another certificate of that "
                "name; give the process another one"
            )
        _check_name("process", process.name)
        yield Rights(name=process.name, role=Role.PROCESS, nodes=process.nodes)


def _interfaces(machine: Machine) -> Iterable[Interface]:
    return (item for owner in with_threads(machine) for item in owner.interfaces)


def _policy(system: System) -> Sequence[Rights]:
    if system.policy is None:
        return ()
    log = DiagnosticLog()
    policy = read_policy(system.policy, system, log)
    log.raise_if_errors()
    assert policy is not None
    channels = _Channels()
    channels.does[ObservationKind.MESSAGE][TICKS_CHANNEL] = None
    for leaf in policy.leaves:
        called = dict.fromkeys(filter(None, (leaf.tick, leaf.halt)))
        channels.does[ObservationKind.REQUEST_SENT].update(called)
    for plugin in system.plugins:
        for interface in _interfaces(plugin):
            for channel in _channels_of(interface, plugin.name, policy):
                channels.add(interface, channel)
    return (channels.rights(POLICY, Role.POLICY),)


def _channels_of(interface: Interface, plugin: str, policy: Policy) -> list[str]:
    """The channels that ``interface`` has where its plugin stands in the policy."""
    if interface.kind is InterfaceKind.TIMER:
        return []
    if interface.channel is not None:
        return [interface.channel]
    found = []
    for leaf in policy.leaves:
        for port in leaf.inputs:
            if leaf.plugin != plugin or port.key != interface.port:
                continue
            if port.entry:
                raise RightsError(
                    f"the plugin {plugin} takes the name of a {interface.kind.noun}'s channel from the "
                    f"blackboard ({port.entry}): what it may do is not known before it runs"
                )
            found.append(str(port.value))
    return found
