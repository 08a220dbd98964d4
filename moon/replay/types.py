"""The typed channels of a replay, from the definitions that the recording has."""

from __future__ import annotations

from m2c.language.datatypes import Structure
from m2c.runtime.messages import message_class
from moon.recording.definitions import UnknownTypeError
from moon.recording.reader import Recording
from transports.interface import Action, Reliability, Service, Topic
from transports.ros_forms import OWN_PACKAGES


def topic(recording: Recording, name: str, type_name: str) -> Topic:
    """A topic of the recording; UnknownTypeError if its type is not defined."""
    if not type_name or type_name.startswith(OWN_PACKAGES):
        raise UnknownTypeError(f"{type_name or 'its type'} is not in the recording")
    offer = recording.offer(name)
    reliability = Reliability.BEST_EFFORT if offer.best_effort else Reliability.RELIABLE
    message = message_class(recording.structure(type_name))
    return Topic(name, type_name, message, reliability, offer.transient_local)


def service(recording: Recording, name: str) -> Service:
    """A service of the recording; UnknownTypeError if its type is not defined."""
    part = recording.contents.channels[name].type_name
    base, _, end = part.rpartition("_")
    if end not in ("Request", "Response"):
        raise UnknownTypeError(f"{part or 'its type'} is not that of a service")
    request, response = (recording.structure(f"{base}_{half}") for half in ("Request", "Response"))
    return Service(name, base, message_class(request), message_class(response))


def action(recording: Recording, name: str) -> Action:
    """An action of the recording; UnknownTypeError if one of its parts is not defined."""
    part = recording.contents.channels[f"{name}/_action/send_goal"].type_name
    base = part.rpartition("_SendGoal_")[0]
    if not base:
        raise UnknownTypeError(f"{part or 'its type'} is not that of an action")
    kinds = [
        _inside(recording, f"{base}_{whole}", field)
        for whole, field in (
            ("SendGoal_Request", "goal"),
            ("GetResult_Response", "result"),
            ("FeedbackMessage", "feedback"),
        )
    ]
    return Action(name, base, *(message_class(kind) for kind in kinds))


def _inside(recording: Recording, whole: str, field: str) -> Structure:
    found = recording.structure(whole).field(field)
    if not isinstance(found, Structure):
        raise UnknownTypeError(f"{whole} has no field `{field}`")
    return found
