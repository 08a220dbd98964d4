"""Checking recordings: the oracles of ``moon monitor``, handed what was recorded."""
