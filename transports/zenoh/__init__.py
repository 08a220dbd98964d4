"""The Zenoh transport: peers that find each other by gossip, messages in MessagePack."""

from transports.zenoh.transport import ZenohTransport, connect

__all__ = ["ZenohTransport", "connect"]
