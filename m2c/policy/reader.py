"""Read a BehaviorTree.CPP policy, format 3 or 4 (declared or not), into a :class:`PolicyFile`.

What differs between the formats is translated here, so that everything after knows version 4 only.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

from m2c.diagnostics import DiagnosticLog, shortened
from m2c.model.structure import note_read_as
from m2c.model.xml import Element, read_xml
from m2c.policy import format_3
from m2c.policy.attributes import check_tree_attributes, is_ignored
from m2c.policy.blackboard_check import blackboard_check
from m2c.policy.declared import LEAF_KINDS, MODEL, DeclaredNodes, add_defaults, declared_in
from m2c.policy.folder import TREE, trees_beside
from m2c.policy.includes import elements_of
from m2c.policy.nav2 import nav2_hint
from m2c.policy.nesting import check_nesting
from m2c.policy.ports import bare_entry, check_ports, is_not_given
from m2c.policy.strangers import EXPLICIT, perhaps_plugins
from m2c.policy.tree import (
    ADDRESS,
    AUTOREMAP,
    BLACKBOARD_CHECKS,
    BUILTINS,
    CONDITIONS,
    CONTROLS,
    MANY,
    MARK,
    MARK_IGNORED,
    TIMED,
    BuiltinNode,
    LeafKind,
    LeafNode,
    PolicyFile,
    SubTreeNode,
    Tree,
    TreeNode,
    is_marked,
)
from m2c.suggestions import nearest

_LEAF_HINT = 'a leaf has service_name="/…/tick" or interface="ROS2SERVICE"'
_PLUGIN_HINT = "give the system a plugin of this name"
"""What makes a node known."""
_UNNAMED = "BehaviorTree"
"""What a tree without an ID is called."""
_OWN = ("ID", "name")
"""Attributes of every node that are no ports."""


def bound_hint(leaf: str) -> str:
    """How ``leaf`` is made known as an interface."""
    return f'bind it in the system file, <leaf ID="{shortened(leaf, 80)}" action="/…" type="…"/>'


def read_policy_file(
    path: Path, log: DiagnosticLog, plugins: Mapping[str, bool] | None = MappingProxyType({})
) -> PolicyFile | None:
    """Read the policy in ``path``; None after reporting errors.

    Args:
        path: the XML file.
        log: where faults go: ``unknown-node``, ``duplicate-tree``, ``missing-tree``,
            ``child-count``, ``unknown-port`` and those of ``m2c.policy.ports``,
            :func:`m2c.model.xml.read_xml`,
            ``m2c.policy.includes`` and ``m2c.policy.nesting``.
        plugins: names of behaviour-tree plugins, so that ``<MyPlugin …/>`` is known, and whether
            each takes children (a control node or a decorator); None: they are not known, and what
            is not known may be one.
    """
    own = DiagnosticLog()
    root = read_xml(path, own)
    policy = _PolicyReader(path, own, plugins).read(root) if root is not None else None
    log.diagnostics += own.diagnostics
    return None if own.has_errors else policy


class _PolicyReader:
    def __init__(self, path: Path, log: DiagnosticLog, plugins: Mapping[str, bool] | None) -> None:
        self._path = path
        self._log = log
        self._plugins = plugins or {}
        self._may_have_plugins = plugins is None
        self._declared = DeclaredNodes({}, {})

    def read(self, root: Element) -> PolicyFile | None:
        if root.tag != "root":
            hint = "the root of a behaviour-tree policy is <root>"
            self._log.error("unknown-tag", root.position, root.tag, "not a policy", hint)
            return None
        format_3.check_format(root, self._log)
        own = elements_of(self._path, root, self._log)
        elements = [*own, *trees_beside(own, self._log)]
        if self._may_have_plugins:
            self._plugins = perhaps_plugins(elements)
        self._declared = declared_in(child for child in elements if child.tag == MODEL)
        self._sub_tree_ports = format_3.SubTreePorts(root, elements)
        trees: dict[str, Tree] = {}
        is_alone = sum(child.tag == TREE for child in own) == 1
        for child in elements:
            if child.tag == TREE and not child.get("ID") and not is_alone:
                what = "the attribute `ID` is missing"
                hint = "where a file has several trees, each needs a name"
                self._log.error("missing-attribute", child.position, child.tag, what, hint)
            elif child.tag == TREE:
                tree = self._read_tree(child, trees)
                if tree is not None:
                    trees[tree.id] = tree
            elif child.tag != MODEL:
                known = (TREE, MODEL, "include")
                what = "not an element of <root>"
                hint = nearest(child.tag, known)
                self._log.error("unknown-tag", child.position, child.tag, what, hint)
        if self._log.has_errors:
            return None  # what follows would blame other places for the trees that are missing
        check_nesting(trees, self._log)
        main = self._main_tree(root, trees, [item.get("ID") for item in own if item.tag == TREE])
        if main is None:
            return None
        return PolicyFile(self._path, main, tuple(trees.values()))

    def _main_tree(self, root: Element, trees: dict[str, Tree], own: list[str]) -> str | None:
        if not trees:
            what = "the policy has no <BehaviorTree>"
            self._log.error("missing-tree", root.position, root.tag, what)
            return None
        named = root.get("main_tree_to_execute")
        if named in trees:
            return named
        if named:
            what = f"the main tree `{named}` does not exist"
            at = root.at("main_tree_to_execute")
            self._log.error("missing-tree", at, root.tag, what, nearest(named, trees))
            return None
        if len(own) == 1:
            return own[0] or _UNNAMED
        what = f"which of the trees {', '.join(own)} is executed is not said"
        hint = 'write main_tree_to_execute="…"'
        self._log.error("missing-tree", root.position, root.tag, what, hint)
        return None

    def _read_tree(self, element: Element, trees: dict[str, Tree]) -> Tree | None:
        name = element.get("ID") or _UNNAMED
        check_tree_attributes(element, self._log)
        if name in trees:
            what = f"a second tree `{name}`"
            hint = f"the first stands at {trees[name].position}"
            self._log.error("duplicate-tree", element.at("ID"), element.tag, what, hint)
            self._give_up(element)
            return None
        if len(element.children) != 1:
            what = f"a tree has one root node, this one has {len(element.children)}"
            self._log.error("child-count", element.position, element.tag, what)
            self._give_up(element)
            return None
        root = self._read_node(element.children[0])
        return Tree(name, root, element.position) if root is not None else None

    def _read_node(self, element: Element) -> TreeNode | None:
        tag = element.tag
        if tag in EXPLICIT:
            tag = element.get("ID")
            if not tag:
                what = "the attribute `ID` is missing"
                self._log.error("missing-attribute", element.position, element.tag, what)
                self._give_up(element)
                return None
        if tag in format_3.NODES:
            meaning = f"`{format_3.NODES[tag]}`"
            note_read_as(element.position, element.tag, tag, meaning, self._log, format_3.CALLED)
            tag = format_3.NODES[tag]
        if tag == "SubTree":
            return self._read_sub_tree(element)
        if tag in self._plugins:
            return self._read_leaf(element, tag, takes_children=self._plugins[tag])
        if tag in TIMED or tag in CONTROLS:
            return self._read_own(self._read_builtin(element, tag))
        if tag in BUILTINS:
            node = self._read_builtin(element, tag)
            return blackboard_check(element, node, self._log) if tag in BLACKBOARD_CHECKS else node
        if element.tag in LEAF_KINDS or self._is_leaf(element, tag):
            return self._read_leaf(element, tag)
        self._unknown(element, tag)
        self._give_up(element)
        return None

    def _give_up(self, element: Element) -> None:
        """What stands below ``element``, which is none that can be read, is looked at all the same."""
        for child in element.children:
            self._read_node(child)

    def _unknown(self, element: Element, tag: str) -> None:
        own = [*self._declared.leaves, *self._plugins]
        known = [*BUILTINS, *own, "SubTree"]
        what = f"unknown node `{tag}`" if tag != element.tag else "unknown node"
        of_nav2 = nav2_hint(tag)
        hint = of_nav2 or nearest(tag, known)
        bound = f"else {bound_hint(tag)}, or {_PLUGIN_HINT}"
        if not of_nav2 and hint.startswith("did you mean"):
            is_typo = element.children or nearest(tag, own).startswith("did you mean")
            hint = hint if is_typo else f"{hint} {bound}"
        elif not of_nav2:
            hint = _PLUGIN_HINT if element.children else f"{_LEAF_HINT}; {bound}"
        self._log.error("unknown-node", element.position, element.tag, what, hint)

    def _is_leaf(self, element: Element, tag: str) -> bool:
        return tag in self._declared.leaves or (
            not element.children and any(key in element.attributes for key in ADDRESS)
        )

    def _read_sub_tree(self, element: Element) -> SubTreeNode | None:
        name = element.get("ID")
        if not name:
            what = "the attribute `ID` is missing"
            self._log.error("missing-attribute", element.position, element.tag, what)
            return None
        kept: dict[str, str] = {}
        for written in element.attributes:
            key = format_3.PORTS.get(("SubTree", written), written)
            known = (*CONDITIONS, AUTOREMAP, written if key == AUTOREMAP else "")
            if written not in _OWN and not is_ignored(element, written, self._log, known):
                self._keep(element, written, key, kept)
                if not key.startswith("_"):
                    kept[key] = self._sub_tree_ports.value(element, written, self._log)
        add_defaults(element, kept, self._declared.sub_trees.get(name, {}), self._log)
        return SubTreeNode(
            id=name,
            name=element.get("name"),
            position=element.position,
            attributes=tuple(kept.items()),
        )

    def _keep(self, element: Element, written: str, key: str, kept: dict[str, str]) -> None:
        """Put the port ``written``, which version 4 calls ``key``, into ``kept``."""
        if key in kept:
            what = f"`{written}` is the port `{key}`, which is given already"
            self._log.error("unknown-port", element.at(written), element.tag, what, "give it once")
            return
        if key != written:
            at = element.at(written)
            note_read_as(at, element.tag, written, f"`{key}`", self._log, format_3.CALLED)
        kept[key] = element.attributes[written]

    def _read_builtin(self, element: Element, tag: str) -> BuiltinNode:
        builtin = BUILTINS[tag]
        count = len(element.children)
        if not builtin.least <= count <= builtin.most:
            if builtin.most == MANY:
                wanted = f"at least {builtin.least}"
            elif builtin.least == builtin.most:
                wanted = str(builtin.least) if builtin.least else "none"
            else:
                wanted = f"{builtin.least} to {builtin.most}"
            what = f"{count} children"
            hint = f"{tag} takes {wanted}"
            self._log.error("child-count", element.position, element.tag, what, hint)
        children = [self._read_node(child) for child in element.children]
        return BuiltinNode(
            tag=tag,
            name=element.get("name"),
            position=element.position,
            attributes=self._ports(element, tag, builtin.ports),
            children=tuple(child for child in children if child is not None),
        )

    def _read_own(self, node: BuiltinNode) -> LeafNode:
        """What the library does not have, and what waits, is run beside the skills, not by the tree."""
        return LeafNode(
            id=node.tag,
            name=node.name or node.tag,
            kind=LeafKind.ACTION,
            position=node.position,
            element=node.tag,
            attributes=node.attributes,
            children=node.children,
        )

    def _ports(
        self, element: Element, tag: str, ports: tuple[str, ...]
    ) -> tuple[tuple[str, str], ...]:
        kept: dict[str, str] = {}
        for written, value in element.attributes.items():
            key = format_3.PORTS.get((tag, written), written)
            if written in _OWN or is_ignored(element, written, self._log):
                continue
            if key in ports and is_not_given(tag, key, value):
                what = f"`{written}` is empty: its default is used"
                self._log.note("empty-port", element.at(written), element.tag, what)
            elif key in ports or key in CONDITIONS:
                self._keep(element, written, key, kept)
            else:
                self._unknown_port(element, written, tag, (*ports, *CONDITIONS))
        if tag == "SetBlackboard" and "output_key" in kept:
            kept["output_key"] = bare_entry(element, "output_key", kept["output_key"], self._log)
        check_ports(element, tag, kept, self._log)
        return tuple(kept.items())

    def _unknown_port(
        self, element: Element, written: str, tag: str, known: tuple[str, ...]
    ) -> None:
        what = f"{tag} has no port `{written}`"
        hint = format_3.INSTEAD.get((tag, written)) or nearest(written, known)
        self._log.error("unknown-port", element.at(written), element.tag, what, hint)

    def _read_leaf(
        self, element: Element, tag: str, takes_children: bool = False
    ) -> LeafNode | None:
        if takes_children and not element.children:
            what = f"the plugin `{tag}` ticks children, and has none here"
            self._log.error("child-count", element.position, element.tag, what)
            return None
        children = [self._read_node(child) for child in element.children if takes_children]
        if element.children and not takes_children:
            child = element.children[0]
            what = f"the leaf `{tag}` cannot have children"
            self._log.error("child-count", child.position, child.tag, what)
            self._give_up(element)
            return None
        declared = self._declared.leaves.get(tag)
        kind = LEAF_KINDS.get(element.tag) or (declared.kind if declared else None)
        attributes = {**element.attributes}
        if declared is not None:
            given = declared.defaults if tag in self._plugins else declared.read
            attributes = {**given, **attributes}
        own = [*_OWN]
        if tag not in self._plugins:  # a plugin may declare a port of that name
            own.append(MARK)
            own += [name for name in element.attributes if is_ignored(element, name, self._log)]
            if is_marked(attributes.get(MARK, "")):
                self._log.note("monitored-leaf", element.at(MARK), element.tag, *MARK_IGNORED)
        return LeafNode(
            id=tag,
            name=element.get("name") or tag,
            kind=kind,
            position=element.position,
            element=element.tag,
            attributes=tuple(
                (key, value.strip()) for key, value in attributes.items() if key not in own
            ),
            children=tuple(child for child in children if child is not None),
        )
