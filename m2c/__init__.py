"""Compile deliberation models into running nodes."""
