"""The models' diagrams for a page, and which of their parts a place in a model is."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import msgspec
from markupsafe import Markup

from m2c.draw import Picture, draw_machine, draw_policy, inline, leaf_keys, transition_keys, tree_of
from m2c.draw.bounds import TooLargeError
from m2c.model import DiagnosticLog, System, load

POLICY = "policy"


class Figure(msgspec.Struct, frozen=True):
    """A diagram.

    Attributes:
        name: of the machine; ``policy`` for the tree.
        prefix: of its ids.
        svg: an element for an HTML page.
        keys: ``file:line:column`` → the keys of the transitions (leaves) there.
    """

    name: str
    prefix: str
    svg: Markup
    keys: dict[str, str]

    def marked(self, places: Iterable[str]) -> list[str]:
        """The keys of what stands at ``places``.

        Files are distinguished by their names where their paths differ: the models may have been named
        otherwise when the verdict was reported.
        """
        by_name = {_short(place): keys for place, keys in self.keys.items()}
        found: dict[str, None] = {}
        for place in places:
            keys = self.keys.get(place) or by_name.get(_short(place), "")
            found.update(dict.fromkeys(keys.split()))
        return list(found)


def figures_of(system: System | None, wanted: Iterable[str]) -> dict[str, Figure]:
    """The diagrams of those of ``wanted`` that are machines of ``system``, and of its policy.

    There is none of what is too large for a picture.
    """
    if system is None:
        return {}
    names = set(wanted)
    found: dict[str, Figure] = {}
    for machine in (*system.nodes, *system.plugins):
        if machine.name in names and machine.name not in found:
            prefix = f"d{len(found)}-"
            try:
                svg = _element(draw_machine(machine, prefix), machine.name, prefix)
            except TooLargeError:
                continue
            found[machine.name] = Figure(machine.name, prefix, svg, transition_keys(machine))
    policy = _policy(system, f"d{len(found)}-")
    if policy is not None:
        found.setdefault(POLICY, policy)
    return found


def read_system(models: Iterable[str], interfaces: Iterable[str]) -> System | None:
    """The models that were checked; None without any, or if they are no longer there."""
    paths = [Path(path) for path in models]
    if not paths or not all(path.exists() for path in paths):
        return None
    folders = [path for path in map(Path, interfaces) if path.is_dir()]
    return load(paths, DiagnosticLog(), folders)


def _policy(system: System, prefix: str) -> Figure | None:
    if system.policy is None:
        return None
    from m2c.policy.plugins import has_children
    from m2c.policy.reader import read_policy_file

    plugins = {plugin.name: has_children(plugin) for plugin in system.plugins}
    file = read_policy_file(system.policy, DiagnosticLog(), plugins)
    if file is None:
        return None
    try:
        tree = tree_of(file)
    except TooLargeError:
        return None
    svg = _element(draw_policy(tree, prefix), POLICY, prefix)
    return Figure(POLICY, prefix, svg, leaf_keys(tree))


def _element(picture: Picture, title: str, prefix: str) -> Markup:
    """``picture`` for a page, in which it stands as it is.

    It is markup, of our own drawer, which escapes every text of a model (``m2c.draw.svg.clean``).
    """
    return Markup(inline(picture, title, prefix))


def _short(place: str) -> str:
    return place.replace("\\", "/").rpartition("/")[2]
