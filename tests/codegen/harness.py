"""Generating a machine into a folder, importing it and recording what it sends."""

from __future__ import annotations

import importlib
import itertools
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

from m2c.codegen.names import machine_class
from m2c.model import DiagnosticLog, load
from tests.codegen.files import node_modules

_numbers = itertools.count()


class Recorder:
    """Stands in for the node: remembers every output in order."""

    def __init__(self) -> None:
        self.sent: list[tuple[Any, ...]] = []

    def __getattr__(self, name: str) -> Any:
        def record(*arguments: Any) -> None:
            self.sent.append((name, *arguments))

        return record

    def names(self) -> list[str]:
        """Names of the outputs so far; forgets them."""
        found = [item[0] for item in self.sent]
        self.sent.clear()
        return found


class Generated:
    """A generated machine, started, with its modules."""

    def __init__(
        self,
        folder: Path,
        text: str,
        interfaces: dict[str, str] | None = None,
        lenient: bool = False,
    ) -> None:
        for name, content in (interfaces or {}).items():
            path = folder / "interfaces" / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(content)
        model = folder / "model.scxml"
        model.write_text(text)
        log = DiagnosticLog()
        system = load([model], log)
        assert system is not None
        assert not log.has_errors, log.diagnostics
        system = system.made_lenient() if lenient else system
        self.machine_model = system.nodes[0]
        self.library = system.library
        self.package = f"generated_{next(_numbers)}"
        self.files = node_modules(self.machine_model, system.library, self.package)
        target = folder / self.package
        target.mkdir()
        for name, content in self.files.items():
            (target / name).write_text(content)
        sys.path.insert(0, str(folder))
        try:
            importlib.invalidate_caches()
            self.machine = self.load("machine")
            self.interfaces = self.load("interfaces")
            self.node = self.load("node")
        finally:
            sys.path.remove(str(folder))
        self.outputs = Recorder()
        made = getattr(self.machine, machine_class(self.machine_model.name))
        self.it: Any = made(self.outputs)
        self.it.start()

    def load(self, name: str) -> ModuleType:
        """The generated module ``name``."""
        return importlib.import_module(f"{self.package}.{name}")
