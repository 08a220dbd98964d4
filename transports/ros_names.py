"""Names that ROS 2 takes, checked without ROS 2: models are checked where it is not installed.

Rules: https://design.ros2.org/articles/topic_and_service_names.html and the headers
``rmw/validate_full_topic_name.h``, ``rmw/validate_node_name.h``. A test compares with rclpy's own.
"""

from __future__ import annotations

import re
import unicodedata

_TOPIC = 255 - 8
"""RMW_TOPIC_MAX_NAME_LENGTH: eight characters of DDS's 255 are for prefixes."""
_EVENTS = len("/_service_event")
MOST = {
    "node": 255,  # RMW_NODE_NAME_MAX_NAME_LENGTH
    "topic": _TOPIC,
    "service": _TOPIC - _EVENTS,  # its events are a topic
    "action": _TOPIC - len("/_action/cancel_goal") - _EVENTS,  # its longest service
}
"""Characters that a name may have, by what it names."""

_OTHER = re.compile(r"[^A-Za-z0-9_]")
_FIELD = re.compile(r"[a-z][a-z0-9]*(_[a-z0-9]+)*")
"""https://design.ros2.org/articles/legacy_interface_definition.html, "Field names"."""
_STRUCTURE = re.compile(r"[A-Z][A-Za-z0-9]*")
"""The same page, "Message and service file names": VALID_MESSAGE_NAME_PATTERN of rosidl_adapter."""


def refusal(kind: str, name: str) -> tuple[str, str] | None:
    """Why ROS 2 does not take ``name``, and a name that it takes; None if it takes it.

    Args:
        kind: ``node``, ``topic``, ``service`` or ``action``; of messages: ``field``, ``type`` of a field,
            ``structure`` (a type's own name).
        name: without a namespace; a channel's is absolute.
    """
    if kind == "field":
        return _field_refusal(name)
    if kind == "structure":
        return _structure_refusal(name)
    if kind == "type":
        nested = "][" in name
        return ("it has no arrays of arrays", "an array of structures with one") if nested else None
    parts = [name] if kind == "node" else name.removeprefix("/").split("/")
    for part in parts:
        other = _OTHER.search(part)
        if other is not None:
            shown = "a blank" if other[0] == " " else f"`{other[0]}`"
            return f"it has {shown}; a-z, A-Z, 0-9 and _ may be in it", _written(parts, kind)
        if not part:
            return "it has an empty part", _written(parts, kind)
        if part[0].isdigit():
            within = "it" if kind == "node" else f"its part `{part}`"
            return f"{within} begins with a digit", _written(parts, kind)
    if len(name) > MOST[kind]:
        return f"it has {len(name)} characters; at most {MOST[kind]} are allowed", ""
    return None


def _field_refusal(name: str) -> tuple[str, str] | None:
    if _FIELD.fullmatch(name) is not None:
        return None
    words = re.sub(r"_+", "_", _plain(name).lower()).strip("_")
    right = words if words[:1].isalpha() else f"n{words}"
    return "lower-case letters, digits and single underscores may be in it", right


def _structure_refusal(name: str) -> tuple[str, str] | None:
    if _STRUCTURE.fullmatch(name) is not None:
        return None
    right = "".join(word[:1].upper() + word[1:] for word in _plain(name).split("_"))
    return "it begins with a capital letter, and letters and digits may be in it", right


def _written(parts: list[str], kind: str) -> str:
    """The nearest name: ``/tank/fill it-é`` is ``/tank/fill_it_e``."""
    plain = "/".join(filter(None, map(_plain, parts))) or "name"
    return plain if kind == "node" else f"/{plain}"


def _plain(part: str) -> str:
    if part and not _OTHER.search(part) and not part[0].isdigit():
        return part
    letters = (
        item for item in unicodedata.normalize("NFKD", part) if not unicodedata.combining(item)
    )
    word = re.sub(r"_+", "_", _OTHER.sub("_", "".join(letters))).strip("_")
    return f"n{word}" if word[:1].isdigit() else word
