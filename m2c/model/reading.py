"""Reading a system that must be whole."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import msgspec

from m2c.changes import UNCHANGED, Changes
from m2c.diagnostics import DiagnosticLog, ModelError, Position
from m2c.model.loading import load
from m2c.model.overrides import with_changes
from m2c.model.system import System


def read_or_raise(
    paths: Sequence[Path], interfaces: Sequence[Path] = (), changes: Changes = UNCHANGED
) -> System:
    """The system in ``paths``, with what its reader found as ``findings``.

    Args:
        paths: models, folders of them, or one system file.
        interfaces: folders of interface packages.
        changes: how the models are changed.

    Raises:
        ModelError: there are errors in a file, or there is no model.
    """
    log = DiagnosticLog()
    system = load(paths, log, interfaces)
    if system is not None:
        system = with_changes(system, changes, log)
    log.raise_if_errors()
    if system is None or not (system.nodes or system.plugins):
        log.error("no-models", Position(str(paths[0])), "", "no model in it")
        raise ModelError(log.diagnostics)
    return msgspec.structs.replace(system, findings=tuple(log.diagnostics))
