"""What ``moon check`` found, as one HTML page that needs nothing else."""

from moon.report.page import write_report

__all__ = ["write_report"]
