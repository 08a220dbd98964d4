"""Monitoring: oracles of a running system, their verdicts, and where those go."""
