"""What a model is, and reading it: no middleware, no I/O besides reading files."""

from m2c.diagnostics import Diagnostic, DiagnosticLog, ModelError, Position, Severity
from m2c.model.interfaces import InterfaceLibrary
from m2c.model.loading import load, read_system
from m2c.model.machine import Machine
from m2c.model.reader import read_machine
from m2c.model.system import System

__all__ = [
    "Diagnostic",
    "DiagnosticLog",
    "InterfaceLibrary",
    "Machine",
    "ModelError",
    "Position",
    "Severity",
    "System",
    "load",
    "read_machine",
    "read_system",
]
