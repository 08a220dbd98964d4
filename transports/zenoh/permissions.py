"""Which names may be claimed on which key, by the rules of access control that this process was given.

A message names its sender in an attachment, which its sender writes. Access control says who may send on a
key at all. So what comes on a key in a name that has no right on it is another's: whoever enforced the rules
let it pass by the right of its own certificate.
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping
from typing import Any

from transports.zenoh.names import ANSWER_KEYS, node_of
from transports.zenoh_link.session import access_control

NOBODY: frozenset[str] = frozenset()


class _AllBut:
    """Every name but some."""

    __slots__ = ("_names",)

    def __init__(self, names: frozenset[str]) -> None:
        self._names = names

    def __contains__(self, name: object) -> bool:
        return name not in self._names


class Permissions:
    """What the nodes of a system may send, by the name of each.

    Args:
        puts: who may publish on each key.
        queries: who may call on each key.
        nodes: the names of all nodes, and the policy's: those of which there are models.
    """

    def __init__(
        self,
        puts: Mapping[str, frozenset[str]],
        queries: Mapping[str, frozenset[str]],
        nodes: frozenset[str],
    ) -> None:
        self._puts = puts
        self._queries = queries
        self.nodes = nodes

    def publishers(self, key: str) -> Container[str]:
        """The names in which something may come on ``key``."""
        return self._of(self._puts, key)

    def callers(self, key: str) -> Container[str]:
        """The names in which ``key`` may be queried."""
        return self._of(self._queries, key)

    def _of(self, rights: Mapping[str, frozenset[str]], key: str) -> Container[str]:
        """Of a key that is no node's, every name but theirs: the tools' have names of their own."""
        return rights.get(key) or _AllBut(self.nodes)


def permissions_of(access: Mapping[str, Any], namespace: str = "") -> Permissions | None:
    """What the section ``access_control`` of a configuration allows; None if it is not in force.

    Args:
        access: the section, as ``transports.zenoh.access.access_control`` makes it.
        namespace: the prefix that the session takes from every key.
    """
    if not access.get("enabled", False):
        return None
    rules = {rule["id"]: rule for rule in access.get("rules") or ()}
    begin = f"{namespace}/" if namespace else ""
    granted: dict[str, dict[str, set[str]]] = {"put": {}, "query": {}, "declare_queryable": {}}
    for policy in access.get("policies") or ():
        who = {*policy["subjects"]}  # called by the names of the processes
        for rule in (rules[rule] for rule in policy["rules"]):
            if "ingress" not in (rule.get("flows") or ("ingress",)):
                continue
            for message in granted.keys() & {*rule["messages"]}:
                for key in rule["key_exprs"]:
                    granted[message].setdefault(key.removeprefix(begin), set()).update(who)
    nodes = frozenset(_answerers(granted["declare_queryable"]))
    return Permissions(_among(granted["put"], nodes), _among(granted["query"], nodes), nodes)


def _answerers(queryables: Iterable[str]) -> Iterable[str]:
    """Those who may say how far they have reported: nodes."""
    for key in queryables:
        begin, _, chunk = key.rpartition("/")
        if begin == f"{ANSWER_KEYS}/*":
            yield node_of(chunk)


def _among(granted: Mapping[str, set[str]], nodes: frozenset[str]) -> dict[str, frozenset[str]]:
    return {key: frozenset(names & nodes) for key, names in granted.items()}


def permissions_for(options: Mapping[str, str]) -> Permissions | None:
    """What the access control of the session that ``options`` ask for allows; None: it has none."""
    found = access_control(options)
    return None if found is None else permissions_of(*found)
