"""Recordings: what a tap heard, kept in files."""
