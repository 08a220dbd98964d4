"""Python names for what a model names. All are ASCII: Python compares others in Unicode's normal form."""

from __future__ import annotations

import builtins
import keyword
import re
import sys
from collections.abc import Container, Iterable, Sequence

_WORD_BREAK = re.compile(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])")
_MAX_LENGTH = 100
"""Of names made from names: a file's or folder's may have 255 bytes, and ours get endings."""

_ANNOTATIONS = frozenset({"bool", "dict", "float", "int", "list", "object", "str"})
_INTERFACES = frozenset(
    {
        *("Annotated", "ClassVar", "TypedMessage", "msgspec"),
        *(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)),
    }
)
MODULE_NAMES = frozenset(
    {
        *("Any", "Callable", "Enum", "Final", "Mapping", "MappingProxyType", "Path", "Protocol"),
        *("copy", "deque", "ecmascript", "main", "matches", "random", "run", "seconds"),
        *("EndlessLoopError", "ExecutionError", "Outputs", "PARAMETERS", "PLUGINS", "begun"),
        *("DEFAULT_SETTINGS", "Binding", "GoalHandlers", "NodeSettings", "BtNodeContext"),
        *("Action", "Reliability", "Service", "Topic", "Transport"),
        *_INTERFACES,
        *keyword.kwlist,
    }
)
"""What the templates import or define at the top of a module: nothing of a model is called so there."""

_FIELDS = frozenset({*_ANNOTATIONS, *_INTERFACES, *keyword.kwlist})
"""What the body of a message class names itself."""
_ATTRIBUTES = frozenset({*MODULE_NAMES, *_ANNOTATIONS, "state", "start", "thread_id"})

_PACKAGES = frozenset(
    {
        *sys.stdlib_module_names,
        *("asynchat", "asyncore", "distutils", "imp", "smtpd"),  # gone since Python 3.12
        *("m2c", "moon", "transports", "tests", "examples", "setuptools", "pip", "pkg_resources"),
        *(
            "behaviortreepy",
            "click",
            "esprima",
            "jinja2",
            "lxml",
            "lz4",
            "markupsafe",
            "mcap",
            "msgspec",
        ),
        *(
            "numpy",
            "pygments",
            "rich",
            "rosbags",
            "ruamel",
            "ruff",
            "typing_extensions",
            "yaml",
            "zenoh",
        ),
        *(
            "ament_index_python",
            "builtin_interfaces",
            "launch",
            "launch_ros",
            "rcl_interfaces",
            "rclpy",
        ),
        *(
            "rosidl_parser",
            "rosidl_pycommon",
            "rpyutils",
            "service_msgs",
            "std_msgs",
            "action_msgs",
        ),
    }
)
"""Packages that nodes import, directly or not: a node's own must not stand in their place."""


def snake(text: str) -> str:
    """``GoToPoi`` as ``go_to_poi``; anything but letters and digits becomes one underscore."""
    words = re.sub(r"[^0-9A-Za-z]+", "_", _WORD_BREAK.sub("_", text)).lower()
    words = re.sub(r"_+", "_", words)[:_MAX_LENGTH].strip("_") or "unnamed"
    words = f"n{words}" if words[0].isdigit() else words
    return f"{words}_" if keyword.iskeyword(words) else words


def camel(text: str) -> str:
    """``battery_level-skill`` as ``BatteryLevelSkill``; capitals inside words are kept."""
    words = [word for word in re.split(r"[^0-9A-Za-z]+", text) if word]
    name = "".join(word[0].upper() + word[1:] for word in words)[:_MAX_LENGTH] or "Unnamed"
    name = f"N{name}" if name[0].isdigit() else name
    return f"{name}_" if keyword.iskeyword(name) else name


def machine_class(name: str) -> str:
    """The class of the machine ``name``; ``EnumMachine`` for one called as what its module imports."""
    made = camel(name)
    return f"{made.rstrip('_')}Machine" if made in {*MODULE_NAMES, *dir(builtins)} else made


def package_name(text: str, taken: Container[str] = ()) -> str:
    """The package of the node (policy, system) ``text``: ``signal_node``, as ``signal`` is Python's.

    Args:
        text: what the model calls it.
        taken: packages that the system has already, and those of the types that it uses.
    """
    name = snake(text)
    if name in _PACKAGES or name in taken or keyword.iskeyword(name.rstrip("_")):
        name = f"{name.rstrip('_')}_node"
    return distinct(name, taken)


def attributes(names: Iterable[str]) -> dict[str, str]:
    """The attribute of each of the datamodel's variables ``names``, all different."""
    found: dict[str, str] = {}
    plain = [name for name in names if not _needs_another(name)]
    found.update(zip(plain, plain, strict=True))
    for name in names:
        if name not in found:
            safe = re.sub(r"[^0-9A-Za-z_]", "_", name).strip("_")
            found[name] = distinct(f"data_{safe}", found.values())
    return found


def _needs_another(name: str) -> bool:
    usable = name.isascii() and name.isidentifier()
    return not usable or name in _ATTRIBUTES or name.startswith(("_", "on_"))


def field_attribute(name: str) -> str:
    """The attribute of a message class that holds field ``name``.

    One that begins with a capital, as a member of a declared structure may, could be called like a class.

    Raises:
        ValueError: it is no name as interface definitions have them (their reader refuses others).
    """
    if not (name.isascii() and name.isidentifier()):
        raise ValueError(f"{name!r} is no name of a field")
    return f"{name}_" if name in _FIELDS or name[0].isupper() else name


def constant(name: str, taken: Container[str]) -> str:
    """``checkLevel`` as ``CHECK_LEVEL``, made different from all of ``taken``."""
    return distinct(snake(name).upper(), taken)


def distinct(name: str, taken: Container[str]) -> str:
    """``name``, or ``name_2``… if it is taken."""
    candidate, number = name, 2
    while candidate in taken:
        candidate, number = f"{name}_{number}", number + 1
    return candidate


def channel_names(channels: Sequence[str]) -> dict[str, str]:
    """A short name per channel: its last part, or as many parts as tell it from the others.

    ``/A/tick`` alone is ``tick``; beside ``/B/tick`` they are ``a_tick`` and ``b_tick``.
    """
    unique = list(dict.fromkeys(channels))
    names: dict[str, str] = {}
    for channel in unique:
        parts = [part for part in channel.split("/") if part] or [channel]
        for length in range(1, len(parts) + 1):
            name = snake("_".join(parts[-length:]))
            if all(name != _tail(other, length) for other in unique if other != channel):
                break
        names[channel] = distinct(name, names.values())
    return names


def _tail(channel: str, length: int) -> str:
    parts = [part for part in channel.split("/") if part] or [channel]
    return snake("_".join(parts[-length:]))
