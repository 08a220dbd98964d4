"""Checking recordings: the oracles of ``moon monitor``, told what was recorded."""
