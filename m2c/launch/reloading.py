"""``m2c run --watch``: what becomes of a running system when its models change."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import msgspec

from m2c.check.report import print_findings
from m2c.codegen.package import system_files
from m2c.codegen.writer import write_files
from m2c.launch.description import FILE, is_code, read_description
from m2c.launch.options import RunOptions
from m2c.launch.reading import read_changed
from m2c.model import DiagnosticLog, ModelError
from m2c.model.naming import Naming
from m2c.model.system import System
from m2c.watched import DEFINITIONS, WatchedFiles, named


class Reload(msgspec.Struct, frozen=True):
    """What follows from a change.

    Attributes:
        said: a line for the screen.
        nodes: those whose code was generated anew, sorted.
    """

    said: str
    nodes: tuple[str, ...] = ()


class Models:
    """The models of a running system, and the code that was generated from them.

    Args:
        options: the command line.
        changed: what is run in nodes' places, by their names.
        naming: the transports that must take the names of nodes and channels.
        system: as it is generated.
        folder: of the generated code.
    """

    def __init__(
        self,
        options: RunOptions,
        changed: dict[str, Path],
        naming: Naming,
        system: System,
        folder: Path,
    ) -> None:
        self._options = options
        self._changed = changed
        self._naming = naming
        self._folder = folder
        models = [path for path in changed.values() if not is_code(path)]
        self._files = WatchedFiles((options.system, *options.interfaces, *models))
        self._files.follow(system)
        self._generated = system_files(system, naming=naming)
        self._nodes = {node.path: node.name for node in read_description(folder).nodes}
        """By the folders of their packages in the generated code."""
        self._shared = ""
        """What has changed that all nodes share."""

    def look(self) -> Reload | None:
        """What has changed since the last look, generated anew; None: nothing.

        A change of what nodes share (interface types, the system file, the policy) is left for a new run.
        """
        files = self._files.changed()
        if not files:
            return None
        log = DiagnosticLog()
        system = read_changed(self._options, self._changed, self._naming, log)
        self._files.follow(system)
        generated = None
        try:
            if system is not None and not log.has_errors:
                generated = system_files(system, naming=self._naming)
        except ModelError as error:
            log.diagnostics += error.diagnostics
        print_findings(log.diagnostics)
        if generated is None:
            return Reload(f"{named(files)} and cannot be used: the old nodes go on")
        if generated == self._generated:  # whatever was changed is as it runs, again
            self._shared = ""
            return Reload(f"{named(files)}; {_are_replaced(())}")
        differing = {
            name
            for name in generated.keys() | self._generated.keys()
            if generated.get(name) != self._generated.get(name)
        } - {FILE}
        owners = {name: self._nodes.get(name.partition("/")[0], "") for name in differing}
        self._shared = self._shared or self._shared_of(files, owners)
        if self._shared:
            return Reload(f"{named(files)}: all nodes share {self._shared}; stop, and run it again")
        write_files({name: generated[name] for name in differing}, self._folder, force=True)
        self._generated = generated
        nodes = tuple(sorted(set(owners.values())))
        return Reload(f"{named(files)}; {_are_replaced(nodes)}", nodes)

    def _shared_of(self, files: Sequence[Path], owners: Mapping[str, str]) -> str:
        """What of ``files`` cannot be replaced in one node; "" if all can."""
        if any(path.suffix in DEFINITIONS for path in files):
            return "the interface types"
        if self._options.system.resolve() in files:
            return "the system file"
        return "" if all(owners.values()) else "the policy and the types of events"


def _are_replaced(nodes: Sequence[str]) -> str:
    if not nodes:
        return "no node is another for it"
    return f"{', '.join(nodes)} {'is' if len(nodes) == 1 else 'are'} started again"
