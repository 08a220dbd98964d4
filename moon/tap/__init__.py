"""Observations, live: what happens on every channel."""
