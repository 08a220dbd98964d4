"""A model in plain SCXML: channels are in the names of its events."""

from __future__ import annotations

import msgspec

from tests.campaign.elements import Element

_READ = ("_msg.", "_req.", "_res.")
_DROPPED = ("ros_service_handle_error",)
"""What plain SCXML cannot say."""
_OF_TREE = {"tick": ("CMD_TICK", "TICK_RESPONSE"), "halt": ("CMD_HALT", "HALT_RESPONSE")}
_SAID = {
    "ros_topic_callback": "Sub",
    "ros_topic_publish": "Pub",
    "ros_service_send_request": "Call",
    "ros_service_handle_response": "Return",
}
_HANDLERS = ("ros_topic_callback", "ros_service_handle_request", "ros_service_handle_response")
_DECLARATIONS = ("ros_topic_", "ros_service_server", "ros_service_client")


def can_be_plain(root: Element) -> bool:
    """Whether plain SCXML can say all of it: no timers, no actions, services of ticks and halts only."""
    for item in root.all():
        if item.tag.startswith(("ros_action", "ros_time_rate", "ros_rate", "bt_")):
            return False
    return all(
        channel.endswith(("/tick", "/halt"))
        for item in root.children
        if item.tag == "ros_service_server"
        for channel in _channels(item).values()
    )


def plain(root: Element) -> Element:
    """The same machine in plain SCXML."""
    channels: dict[str, str] = {}
    for item in root.children:
        channels |= _channels(item)
    kept = [item for item in root.children if not item.tag.startswith(_DECLARATIONS)]
    return root.holding(*(_said(item, channels) for item in kept))


def _channels(declaration: Element) -> dict[str, str]:
    """What it calls its channel, and the channel."""
    if not declaration.tag.startswith(_DECLARATIONS):
        return {}
    for key in ("topic", "service_name", "service"):
        channel = declaration.get(key)
        for child in declaration.children:
            channel = child.text if child.tag == key else channel
        if channel:
            return {declaration.get("name") or channel: channel}
    return {}


def _said(item: Element, channels: dict[str, str]) -> Element:
    children = tuple(_said(child, channels) for child in item.children if child.tag not in _DROPPED)
    attributes = tuple((name, _read(value)) for name, value in item.attributes)
    text = _read(item.text)
    if not item.tag.startswith("ros_"):
        tag = "param" if item.tag == "field" else item.tag
        return Element(tag, attributes, children, text)
    channel = channels[item.get("name")]
    event = _event(item.tag, channel)
    rest = tuple(pair for pair in attributes if pair[0] != "name")
    tag = "transition" if item.tag in _HANDLERS else "send"
    children = tuple(
        msgspec.structs.replace(child, tag="param") if child.tag == "field" else child
        for child in children
    )
    return Element(tag, (("event", event), *rest), children)


def _event(tag: str, channel: str) -> str:
    last = channel.rpartition("/")[2]
    if tag == "ros_service_handle_request":
        return _OF_TREE[last][0]
    if tag == "ros_service_send_response":
        return _OF_TREE[last][1]
    return f"{channel[1:].replace('/', '.')}.{_SAID[tag]}"


def _read(text: str) -> str:
    for word in _READ:
        text = text.replace(word, "_event.data.")
    return text
