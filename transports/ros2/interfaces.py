"""From a type's name to rclpy's class for it: ``std_msgs/msg/Int32``, ``pkg/action/Name_SendGoal``."""

# rclpy leaves some of its functions without types
# mypy: disable-error-code="no-untyped-call"

from __future__ import annotations

import functools
import importlib
import sys
from typing import Any

from rclpy.type_support import check_for_type_support

from transports.interface import TransportError

_KINDS = ("msg", "srv", "action")


@functools.lru_cache(maxsize=1024)
def ros_class(type_name: str) -> Any:
    """The class of a message or service type, its type support loaded.

    Besides ``pkg/msg/Name`` and ``pkg/srv/Name``, the parts that rosidl makes of them:
    ``pkg/srv/Name_Request``, ``…_Response``, ``…_Event``, ``pkg/action/Name_SendGoal`` (a
    service), ``…_SendGoal_Request``, ``…_FeedbackMessage`` and so on.

    Raises:
        TransportError: the name is none, its package is not built or not found, or has no such type.
    """
    package, _, rest = type_name.partition("/")
    kind, _, name = rest.partition("/")
    if kind not in _KINDS or not package or not name.isidentifier():
        raise TransportError(
            f"`{type_name}` is no ROS 2 type; expected <package>/<msg|srv|action>/<Name>"
        )
    try:
        module = importlib.import_module(f"{package}.{kind}")
    except ImportError as error:
        raise TransportError(_missing(type_name, package, str(error))) from error
    base = getattr(module, name.partition("_")[0], None)
    found = None if base is None else getattr(sys.modules[base.__module__], name, None)
    if found is None:
        raise TransportError(
            f"the interface package `{package}` that is installed has no type `{type_name}`; "
            "build it anew from the model's interfaces (m2c interfaces build DIRECTORY)"
        )
    try:
        check_for_type_support(found)
    except (ImportError, AttributeError) as error:  # a library is missing, or has another version
        raise TransportError(_missing(type_name, package, str(error))) from error
    return found


def _missing(type_name: str, package: str, error: str) -> str:
    return (
        f"the type `{type_name}` needs the ROS 2 interface package `{package}`, which cannot be "
        f"loaded ({error}); install it, or build it with `m2c interfaces build DIRECTORY` and put "
        "the result on PYTHONPATH, LD_LIBRARY_PATH and AMENT_PREFIX_PATH"
    )
