"""Replaying a recording: its topics are published again, its components answer as they did."""
