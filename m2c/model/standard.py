"""ROS 2's standard interface definitions (Jazzy), which need no file of the user's.

They stand in ``standard_interfaces.txt`` as in their definition files, without comments and default
values: the messages that a core installation has, and the services and actions of example_interfaces
(0.12) and std_srvs (5.3). A definition follows the line ``== pkg/kind/Name``.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from pathlib import Path

_FILE = Path(__file__).with_name("standard_interfaces.txt")
_NO_EXAMPLES = frozenset({"std_msgs/msg/ColorRGBA", "std_msgs/msg/Header"})
"""All other messages of std_msgs are in example_interfaces, too."""


@functools.cache
def standard_texts() -> Mapping[str, str]:
    """The text of each standard definition, by name (``pkg/kind/Name``)."""
    entries = _FILE.read_text(encoding="utf-8").removeprefix("== ").split("\n== ")
    found = {name: text for name, _, text in (entry.partition("\n") for entry in entries)}
    for name, text in list(found.items()):
        if name.startswith("std_msgs/") and name not in _NO_EXAMPLES:
            found[_of_examples(name)] = _of_examples(text)
    return found


def _of_examples(text: str) -> str:
    return text.replace("std_msgs/", "example_interfaces/")
