"""Python names for what a model names."""

from __future__ import annotations

import keyword
import re
from collections.abc import Iterable, Sequence

_WORD_BREAK = re.compile(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])")
_RESERVED_ATTRIBUTES = {"state", "start", "thread_id"}


def snake(text: str) -> str:
    """``GoToPoi`` as ``go_to_poi``; anything but letters and digits becomes one underscore."""
    words = re.sub(r"[^0-9A-Za-z]+", "_", _WORD_BREAK.sub("_", text)).strip("_").lower()
    words = re.sub(r"_+", "_", words) or "unnamed"
    words = f"n{words}" if words[0].isdigit() else words
    return f"{words}_" if keyword.iskeyword(words) else words


def camel(text: str) -> str:
    """``battery_level-skill`` as ``BatteryLevelSkill``; capitals inside words are kept."""
    words = [word for word in re.split(r"[^0-9A-Za-z]+", text) if word]
    name = "".join(word[0].upper() + word[1:] for word in words) or "Unnamed"
    name = f"N{name}" if name[0].isdigit() else name
    return f"{name}_" if keyword.iskeyword(name) else name


def attribute(name: str) -> str:
    """The attribute that holds the datamodel variable ``name``."""
    safe = re.sub(r"\W", "_", name)
    if keyword.iskeyword(safe) or safe in _RESERVED_ATTRIBUTES or safe.startswith(("_", "on_")):
        return f"data_{safe.strip('_')}"
    return safe


def constant(name: str, taken: Iterable[str]) -> str:
    """``checkLevel`` as ``CHECK_LEVEL``, made different from all of ``taken``."""
    return distinct(snake(name).upper(), taken)


def distinct(name: str, taken: Iterable[str]) -> str:
    """``name``, or ``name_2``… if it is taken."""
    used = set(taken)
    candidate, number = name, 2
    while candidate in used:
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
