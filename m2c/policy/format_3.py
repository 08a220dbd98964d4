"""What policies of format 3 write otherwise, in the words of format 4."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator

from m2c.diagnostics import DiagnosticLog
from m2c.model.structure import note_read_as
from m2c.model.xml import Element
from m2c.policy.plugins import referenced_entry
from m2c.policy.tree import AUTOREMAP

NODES = {
    "SequenceStar": "SequenceWithMemory",
    "RetryUntilSuccesful": "RetryUntilSuccessful",
    "SubTreePlus": "SubTree",
}
"""Node types that BehaviorTree.CPP 4 calls otherwise (the typing error is version 3's own)."""
PORTS = {
    ("Parallel", "success_threshold"): "success_count",
    ("Parallel", "failure_threshold"): "failure_count",
    ("SubTree", "__autoremap"): AUTOREMAP,
    ("SubTree", "__shared_blackboard"): AUTOREMAP,
}
INSTEAD = {
    ("Parallel", "threshold"): "write success_count, and in failure_count how many failures end it"
}
"""What is written instead of ports of earlier versions, which meant something else."""
CALLED = "BehaviorTree.CPP 4 calls it so"

FORMAT = "BTCPP_format"
_FORMATS = re.compile(r"[34](\.[0-9]+)*")
_NAME = re.compile(r"[A-Za-z_]\w*")
_ASSIGNED = re.compile(r"([A-Za-z_]\w*)\s*:=")


def check_format(root: Element, log: DiagnosticLog) -> None:
    """Warn of a format that BehaviorTree.CPP does not have: ``ignored-attribute``."""
    declared = root.get(FORMAT)
    if declared and not _FORMATS.fullmatch(declared):
        what = f"there is no format `{declared}`: the file is read as one of format 4"
        hint = f'write {FORMAT}="4", or "3" for one of BehaviorTree.CPP 3'
        log.warning("ignored-attribute", root.at(FORMAT), root.tag, what, hint)


class SubTreePorts:
    """What a ``<SubTree>`` gives its tree: in format 3 the name of an entry, where format 4 has a text.

    A file that declares no format is read as format 3 where another tree has an entry of that name.

    Args:
        root: of the policy's file.
        elements: its trees, with those of included files.
    """

    def __init__(self, root: Element, elements: Iterable[Element]) -> None:
        declared = root.get(FORMAT)
        self._is_3 = declared.startswith("3")
        trees = () if declared else elements
        self._named = {tree.get("ID"): frozenset(_named(tree)) for tree in trees}

    def value(self, element: Element, written: str, log: DiagnosticLog) -> str:
        """The port ``written`` of ``element`` as format 4 has it; noted if it has it otherwise."""
        text = element.attributes[written]
        name = text.strip()
        if element.tag != "SubTree" or _NAME.fullmatch(name) is None:
            return text
        others = (names for tree, names in self._named.items() if tree != element.get("ID"))
        if not self._is_3 and not any(name in names for names in others):
            return text
        why = "in format 3 it is the name of an entry"
        note_read_as(element.at(written), element.tag, text, f"`{{{name}}}`", log, why)
        return f"{{{name}}}"


def _named(element: Element) -> Iterator[str]:
    """Entries that ``element`` or something below it names."""
    for key, value in element.attributes.items():
        if entry := referenced_entry(value, key):
            yield entry
        if element.tag == "SetBlackboard" and key == "output_key":
            yield value.strip()
        yield from _ASSIGNED.findall(value)
    for child in element.children:
        yield from _named(child)
