"""Smaller plans than a given one, for a shrinker: larger pieces are left out first."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

from msgspec.structs import replace

from tests.campaign.elements import Element
from tests.campaign.plans import InvalidPlanError, Plan, read, stated, write

_NEEDED = frozenset({"datamodel", "target", "else", "elseif", "field", "param"})
"""Elements that are not left out by themselves."""


def reductions(plan: Plan) -> Iterator[Plan]:
    """Valid plans that have less: fewer machines, properties, nodes of the tree, transitions, statements."""
    for smaller in candidates(plan):
        if is_valid(smaller):
            yield smaller


def is_valid(plan: Plan) -> bool:
    """Whether no command would refuse it; a system without a node is none to monitor."""
    if all(model.is_plugin for model in plan.models):
        return False
    with TemporaryDirectory() as folder:
        try:
            path = write(plan, Path(folder))
            stated(path, read(path))
        except InvalidPlanError:
            return False
    return True


def candidates(plan: Plan) -> Iterator[Plan]:
    """Plans that have less, in the order of :func:`reductions`; not all of them are valid."""
    yield from _with_fewer_machines(plan)
    yield from _with_fewer_properties(plan)
    if plan.policy is not None:
        models = tuple(model for model in plan.models if not model.is_plugin)
        yield replace(plan, policy=None, leaves=(), models=models)
        for policy in _trees(plan.policy):
            yield replace(plan, policy=policy)
    for number, model in enumerate(plan.models):
        for root in _machines(model.root):
            changed = replace(model, root=root)
            yield replace(plan, models=(*plan.models[:number], changed, *plan.models[number + 1 :]))


def _with_fewer_machines(plan: Plan) -> Iterator[Plan]:
    """A machine is left out, with what the properties say of its channels."""
    for model in plan.models:
        models = tuple(other for other in plan.models if other is not model)
        text = "\n".join(str(other.root) for other in models)
        ports = {name: port for name, port in plan.ports.items() if _channel(port) in text}
        gone = plan.ports.keys() - ports.keys()
        properties = tuple(
            item for item in plan.properties if not any(name in str(item.body) for name in gone)
        )
        yield replace(plan, models=models, ports=ports, properties=properties)


def _channel(port: dict[str, object]) -> str:
    """The channel that ``port`` listens to, as models write it."""
    written = str(next(port[key] for key in ("topic", "service", "action") if key in port))
    event = written.removeprefix("/plain_events/")
    return written if event == written else event.replace("/", ".")


def _with_fewer_properties(plan: Plan) -> Iterator[Plan]:
    if len(plan.properties) > 1:
        half = len(plan.properties) // 2
        for some in (plan.properties[:half], plan.properties[half:]):
            yield replace(plan, properties=some)
    for item in plan.properties:
        yield replace(plan, properties=tuple(p for p in plan.properties if p is not item))


def _trees(root: Element) -> Iterator[Element]:
    """A node is left out, or its child takes its place."""
    for number, child in enumerate(root.children):
        before, after = root.children[:number], root.children[number + 1 :]
        if root.tag not in ("root", "BehaviorTree"):
            yield root.holding(*before, *after)
        if root.tag != "root":
            for inner in child.children:
                yield root.holding(*before, inner, *after)
        for smaller in _trees(child):
            yield root.holding(*before, smaller, *after)


def _machines(root: Element) -> Iterator[Element]:
    """An element of it is left out, larger ones first."""
    for number, child in enumerate(root.children):
        before, after = root.children[:number], root.children[number + 1 :]
        if child.tag not in _NEEDED:
            yield root.holding(*before, *after)
    for number, child in enumerate(root.children):
        before, after = root.children[:number], root.children[number + 1 :]
        for smaller in _machines(child):
            yield root.holding(*before, smaller, *after)
