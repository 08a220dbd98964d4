"""Generated files while they are being made: their texts, and what each was made of."""

from __future__ import annotations

from collections.abc import Mapping

from m2c.codegen.formatting import NotPythonError, formatted
from m2c.codegen.packaging import FILES, Packaging
from m2c.codegen.program import NodeProgram, PackageProgram
from m2c.codegen.rendering import Templates
from m2c.codegen.writer import SEALED, sealed

MODULES = {
    "__init__.py": "node_init.py.j2",
    "interfaces.py": "interfaces.py.j2",
    "machine.py": "machine.py.j2",
    "node.py": "node.py.j2",
}
"""The modules of a node, and the templates that they are made from."""
STEPWISE = MODULES | {"machine.py": "stepwise_machine.py.j2", "node.py": "stepwise_node.py.j2"}
"""The same for a run in steps."""


class Draft:
    """Files being made: their texts, and of which template and for which model each is.

    Args:
        templates: what they are made from.
        packaging: what their packages are installed with.
    """

    def __init__(self, templates: Templates, packaging: Packaging = Packaging.WHEEL) -> None:
        self._templates = templates
        self.packaging = packaging
        self._files: dict[str, str] = {}
        self._made_of: dict[str, tuple[str, str]] = {}

    def add(self, path: str, template: str, model: str, **context: object) -> None:
        """Make the file ``path`` from ``template``, for ``model``."""
        self._made_of[path] = (template, model)
        self._files[path] = self._templates.render(
            template, model, transport=self.packaging.value, **context
        )

    def put(self, path: str, text: str) -> None:
        """Have the file ``path`` with data, which no template makes."""
        self._files[path] = text

    def add_node(
        self, folder: str, node: NodeProgram, modules: Mapping[str, str] = MODULES
    ) -> None:
        """The modules of a node, in ``folder``."""
        for path, template in modules.items():
            self.add(f"{folder}{path}", template, node.name, node=node)

    def add_around(self, folder: str, package: PackageProgram, model: str) -> None:
        """The files around the code of ``package``."""
        for file in FILES[self.packaging]:
            self.add(f"{folder}{file}", f"{file}.j2", model, package=package)
        if self.packaging is Packaging.AMENT:
            self.put(f"{folder}resource/{package.name}", "")

    def texts(self) -> dict[str, str]:
        """The files as their templates made them."""
        return dict(self._files)

    def files(self) -> dict[str, str]:
        """The files formatted, and sealed with their hash.

        Raises:
            TemplateFault: what a template made is not Python.
        """
        try:
            found = formatted(self._files)
        except NotPythonError as error:
            template, model = self._made_of[error.file]
            lines = self._files[error.file].splitlines() or [""]
            line = lines[min(max(error.line, 1), len(lines)) - 1].strip()
            what = f"makes no Python, {error.what} in line {error.line}: {line}"
            raise self._templates.fault(template, model, what) from error
        return {
            path: sealed(text) if path.endswith(SEALED) else text for path, text in found.items()
        }
