"""The transport interface, and the transports that come with it."""
