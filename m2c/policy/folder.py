"""Trees of other files in a policy's folder, which no ``<include>`` names.

Programs register all trees of a folder with BehaviorTree.CPP; then one file uses the trees of another.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from m2c.diagnostics import DiagnosticLog, shortened
from m2c.model.system import POLICY_ROOT
from m2c.model.xml import Element, read_xml
from m2c.policy.declared import MODEL, SUB_TREES
from m2c.suggestions import first_of

TREE = "BehaviorTree"
MAX_FILES = 100
"""Files of a folder that are searched."""
_MAX_SHOWN = 200
"""Characters of a name that a message repeats."""


def trees_beside(elements: Sequence[Element], log: DiagnosticLog) -> list[Element]:
    """The trees that ``elements`` use and do not have, from other files of the folders where they are used.

    Of such a file only those trees count, and what it declares in ``<TreeNodesModel>``.

    Args:
        elements: of a policy, with those of the files that it includes.
        log: gets the note ``tree-beside`` for each tree, and ``missing-subtree`` where several files have it.
    """
    return list(_Beside(log).of(elements))


class _Beside:
    def __init__(self, log: DiagnosticLog) -> None:
        self._log = log
        self._folders: dict[Path, dict[str, list[Element]]] = {}

    def of(self, elements: Sequence[Element]) -> Iterator[Element]:
        known = {element.get("ID") for element in elements if element.tag == TREE}
        opened: set[str] = set()
        pending = [use for element in elements for use in _uses(element)]
        while pending:
            use = pending.pop(0)
            name = use.get("ID")
            if name in known:
                continue
            known.add(name)
            root = self._root_with(name, use)
            if root is None:
                continue
            found = [tree for tree in root.all(TREE) if tree.get("ID") == name]
            pending += [inner for tree in found for inner in _uses(tree)]
            yield from found
            if root.position.file not in opened:
                opened.add(root.position.file)
                yield from root.all(MODEL)

    def _root_with(self, name: str, use: Element) -> Element | None:
        """The root of the file beside that of ``use`` that has the tree ``name``."""
        at, roots = use.at("ID"), self._trees_in(Path(use.position.file).parent).get(name, [])
        files = [Path(root.position.file).name for root in roots]
        if len(roots) > 1:
            what = f"several files of the folder have a tree `{name}`: {first_of(files)}"
            hint = f'include the one that is meant: <include path="{shortened(files[0], _MAX_SHOWN)}"/>'
            self._log.error("missing-subtree", at, use.tag, what, hint)
            return None
        if roots:
            what = f"the tree `{name}` is taken from {shortened(files[0], _MAX_SHOWN)}, which is not included"
            hint = f'write <include path="{shortened(files[0], _MAX_SHOWN)}"/>'
            self._log.note("tree-beside", at, use.tag, what, hint)
        return roots[0] if roots else None

    def _trees_in(self, folder: Path) -> dict[str, list[Element]]:
        """The trees of the files in ``folder``, and the roots of those that have them."""
        if folder not in self._folders:
            trees = self._folders[folder] = {}
            for path in sorted(folder.glob("*.xml"))[:MAX_FILES]:
                root = read_xml(path, DiagnosticLog())
                if root is not None and root.tag == POLICY_ROOT:
                    for name in {tree.get("ID") for tree in root.all(TREE)}:
                        trees.setdefault(name, []).append(root)
        return self._folders[folder]


def _uses(element: Element) -> Iterator[Element]:
    """The places below ``element`` where a tree is put."""
    for child in element.children:
        if child.tag in SUB_TREES:
            yield child
        yield from _uses(child)
