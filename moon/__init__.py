"""Watch a running system without touching it."""
