"""Recordings: what a tap received, kept in files."""
