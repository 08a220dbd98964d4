"""Which elements and attributes of the language the random systems use: of how many systems.

``python -m tests.campaign.coverage [SYSTEMS]`` prints the table.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Iterable

from m2c.model.vocabulary import ATTRIBUTES, HANDLERS
from m2c.policy.tree import BUILTINS, CONDITIONS
from tests.campaign.elements import Element
from tests.campaign.plans import Plan
from tests.campaign.systems import SIZES, make

UNUSED = {
    "scxml.model_src": "of other tools: read, and without a meaning",
    "scxml.binding": "of other tools: read, and without a meaning",
    "scxml.exmode": "of other tools: read, and without a meaning",
    **dict.fromkeys(("initial", "transition.type", "donedata"), "of compound states"),
    **{f"{tag}.type": "of compound states" for tag in HANDLERS},
    "send.type": "one value alone, which is the default",
    "tree._onHalted": "BehaviorTree.CPP ends the process where it fails as a tree is destroyed",
}
"""Elements and attributes that a system cannot use, and why."""


def language() -> tuple[str, ...]:
    """Every element (``assign``), attribute (``assign.expr``) and node of a tree (``tree.Sequence``)."""
    attributes = (f"{tag}.{name}" for tag, names in ATTRIBUTES.items() for name in names)
    nodes = (f"tree.{name}" for name in (*BUILTINS, "SubTree", *CONDITIONS))
    return (*ATTRIBUTES, *sorted(attributes), *nodes)


def used(plan: Plan) -> set[str]:
    """What of the language the system uses."""
    found = {name for model in plan.models for item in model.root.all() for name in _names(item)}
    for item in plan.policy.all() if plan.policy is not None else ():
        found |= {f"tree.{item.tag}", *(f"tree.{name}" for name, _ in item.attributes)}
    return found


def _names(item: Element) -> Iterable[str]:
    """The element and its attributes; names of channels and types may be children."""
    yield item.tag
    yield from (f"{item.tag}.{name}" for name, _ in item.attributes)
    yield from (f"{item.tag}.{child.tag}" for child in item.children)


def covered(plans: Iterable[Plan]) -> dict[str, int]:
    """How many of ``plans`` use each part of the language, the least used first."""
    counts = Counter(name for plan in plans for name in used(plan))
    return {name: counts[name] for name in sorted(language(), key=lambda name: counts[name])}


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description="What of the language random systems use.")
    parser.add_argument("systems", type=int, nargs="?", default=200)
    count = parser.parse_args().systems
    table = covered(make(seed, SIZES[seed % len(SIZES)]) for seed in range(count))
    for name, uses in table.items():
        print(f"{uses:6d} of {count}  {name:45}{UNUSED.get(name, '')}")


if __name__ == "__main__":
    main()
