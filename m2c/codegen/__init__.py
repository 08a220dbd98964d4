"""Machines to Python packages."""
