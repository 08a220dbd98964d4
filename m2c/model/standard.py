"""ROS 2's standard interface definitions (Jazzy), which need no file.

The messages come with rosbags, which is imported only when a model asks for one of them; it ships no services
or actions.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import Any

_SET_BOOL = "bool data\n---\nbool success\nstring message\n"
_TRIGGER = "---\nbool success\nstring message\n"
STANDARD_TEXTS: Mapping[str, str] = {
    "example_interfaces/srv/AddTwoInts": "int64 a\nint64 b\n---\nint64 sum\n",
    "example_interfaces/srv/SetBool": _SET_BOOL,
    "example_interfaces/srv/Trigger": _TRIGGER,
    "example_interfaces/action/Fibonacci": "int32 order\n---\nint32[] sequence\n---\nint32[] sequence\n",
    "std_srvs/srv/Empty": "---\n",
    "std_srvs/srv/SetBool": _SET_BOOL,
    "std_srvs/srv/Trigger": _TRIGGER,
}
"""Services and actions of example_interfaces (0.12) and std_srvs (5.3), as in their definition files."""
_NO_EXAMPLES = frozenset({"std_msgs/msg/ColorRGBA", "std_msgs/msg/Header"})
"""All other messages of std_msgs are in example_interfaces, too."""


@functools.cache
def standard_messages() -> Mapping[str, Any]:
    """The standard messages by name, as rosbags has them: constants, and fields with their types."""
    from rosbags.typesys import Stores, get_typestore  # 90 ms: only for models that need it

    found: dict[str, Any] = dict(get_typestore(Stores.ROS2_JAZZY).fielddefs)
    for name, (constants, fields) in list(found.items()):
        if name.startswith("std_msgs/") and name not in _NO_EXAMPLES:
            own = [(field, _of_examples(kind)) for field, kind in fields]
            found[_named(name)] = (constants, own)
    return found


def _of_examples(kind: Any) -> Any:
    """A type in a message of std_msgs, as in that of example_interfaces."""
    node, argument = kind
    match node.name:
        case "BASE":
            return kind
        case "NAME":
            return node, _named(argument)
        case _:
            return node, (_of_examples(argument[0]), *argument[1:])


def _named(name: str) -> str:
    return name.replace("std_msgs/", "example_interfaces/", 1)
