"""What is to be replayed of a recording: who did what, read in one pass, answers kept."""

from __future__ import annotations

from pathlib import Path

import msgspec

from m2c.model.interfaces import InterfaceLibrary
from moon.oracle.channels import MIDDLEWARE_CHANNELS, MIDDLEWARE_ENDINGS
from moon.recording.reader import Recording, open_recording
from moon.replay.calls import CallBook, RecordedCall
from moon.replay.goals import GoalBook, RecordedGoal
from moon.tap.action_parts import SEPARATOR, action_of
from moon.tap.selection import matches
from transports.interface import Observation, ObservationKind
from transports.ros_forms import CALL_ERRORS

_OTHERS = ("/clock", CALL_ERRORS)

UNNAMED = ""
"""Who published what has no source in the recording."""


class Script(msgspec.Struct, frozen=True):
    """A recording, ready to be replayed.

    Attributes:
        recording: read to its end once; it knows the types of its messages.
        first_ns: when it begins.
        last_ns: when it ends.
        topics: type by channel, of all that will be published.
        publishers: who publishes each of them.
        calls: of services, by channel; those of actions are in ``goals``.
        goals: by action.
    """

    recording: Recording
    first_ns: int
    last_ns: int
    topics: dict[str, str]
    publishers: dict[str, set[str]]
    calls: dict[str, list[RecordedCall]]
    goals: dict[str, list[RecordedGoal]]

    def nodes(self) -> set[str]:
        """Everybody who did something in it; :data:`UNNAMED` for who is not named."""
        found = {node for nodes in self.publishers.values() for node in nodes}
        for calls in self.calls.values():
            found.update(name for call in calls for name in (call.server, call.client))
        for goals in self.goals.values():
            found.update(name for goal in goals for name in (goal.server, goal.call.client))
        return found


class Selected:
    """Which channels are replayed.

    Args:
        globs: of channels (an action stands for its parts); empty: all but those that every node or
            ``moon`` itself has.
    """

    def __init__(self, globs: tuple[str, ...] = ()) -> None:
        self._globs = globs

    def __call__(self, channel: str) -> bool:
        """Whether ``channel`` is replayed."""
        if self._globs:
            names = {channel, action_of(channel) or channel}
            return any(matches(name, glob) for name in names for glob in self._globs)
        return (
            not channel.startswith((*MIDDLEWARE_CHANNELS, *_OTHERS))
            and not channel.endswith(MIDDLEWARE_ENDINGS)
            and not channel.endswith(CALL_ERRORS)
        )


def read_script(path: Path, selected: Selected, library: InterfaceLibrary | None = None) -> Script:
    """Read the recording at ``path``.

    Args:
        path: the recording.
        selected: which channels.
        library: types that the recording does not define.

    Raises:
        RecordingError: it is none.
    """
    return script_of(open_recording(path, library), selected)


def script_of(recording: Recording, selected: Selected) -> Script:
    """The script of ``recording``, which is read to its end."""
    calls, goals = CallBook(), GoalBook()
    topics: dict[str, str] = {}
    publishers: dict[str, set[str]] = {}
    actions: dict[str, None] = {}
    first_ns = last_ns = 0
    for seen in recording.entries(selected):
        if not isinstance(seen, Observation):
            continue
        first_ns = min(first_ns or seen.stamp_ns, seen.stamp_ns)
        last_ns = max(last_ns, seen.stamp_ns)
        action = action_of(seen.channel)
        if action:
            actions[action] = None
        if seen.kind is ObservationKind.MESSAGE_TAKEN:
            continue  # whoever subscribes now takes it anew
        if seen.kind is not ObservationKind.MESSAGE:
            calls.note(seen)
        elif not action:
            topics.setdefault(seen.channel, seen.type_name)
            publishers.setdefault(seen.channel, set()).add(seen.source)
        elif seen.channel.endswith(f"{SEPARATOR}feedback"):
            goals.note_feedback(seen)
    return Script(
        recording,
        first_ns,
        last_ns,
        topics,
        publishers,
        {channel: found for channel, found in calls.calls.items() if not action_of(channel)},
        {action: goals.goals(action, calls.calls) for action in actions},
    )
