"""The Zenoh transport."""
