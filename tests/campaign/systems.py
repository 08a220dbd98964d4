"""Systems made at random: a plan of a seed and a size, which is written as a user would have it.

``python -m tests.campaign.systems SEED [SIZE] FOLDER`` writes one.
"""

from __future__ import annotations

import argparse
from collections.abc import Collection
from enum import StrEnum
from pathlib import Path
from random import Random

import msgspec

from tests.campaign.bound import bound
from tests.campaign.channels import EVENT, Channel, offer, use
from tests.campaign.elements import Element, e
from tests.campaign.kinds import Kinds
from tests.campaign.machines import Machine
from tests.campaign.marks import in_blocks, looped
from tests.campaign.nesting import nested
from tests.campaign.plain import can_be_plain, plain
from tests.campaign.plans import Model, Plan, Spelling, write
from tests.campaign.promises import Promises
from tests.campaign.reductions import reductions
from tests.campaign.skills import Leaf, action, condition, decorator, plugin
from tests.campaign.trees import Tree
from tests.campaign.weights import COMPONENTS, happens, pick

SIZES = (1, 2, 3, 4)
"""From two components without a policy to a system of a dozen machines."""


class Trait(StrEnum):
    """What a system may have that is not drawn with the rest of it: that would change those of all seeds."""

    IN_STEP = "in-step"
    """Components have timers that ring at the same moments, each handled in some states."""
    LOOPS = "loops"
    """Machines assign in loops of one round, and have several blocks on entry and exit."""
    NAV2 = "nav2"
    """The policy has control nodes of Nav2."""
    INSTANCES = "instances"
    """Nodes are instances of models with other names, data and channels."""
    NESTED = "nested"
    """Machines have compound states and history."""
    BOUND = "bound"
    """The policy has leaves that are bound to actions, services and topics of the components."""
    FAST = "fast"
    """Components' timers ring five to twenty times a second."""


def traits_of(seed: int, share: float = 0.3) -> tuple[Trait, ...]:
    """Those that the campaign gives to the system of ``seed``, each to such a share of all."""
    return tuple(it for it in Trait if Random(f"{it} {seed}").random() < share)


def make(seed: int, size: int = 2, traits: Collection[Trait] = ()) -> Plan:
    """The system of a seed: always the same.

    Args:
        seed: any number.
        size: one of :data:`SIZES`.
        traits: what it has besides.
    """
    plan = _Maker(seed, size, traits).plan()
    plan = in_blocks(looped(plan, "[1]")) if Trait.LOOPS in traits else plan
    plan = nested(plan) if Trait.NESTED in traits else plan
    return msgspec.structs.replace(plan, instances=Trait.INSTANCES in traits)


class _Maker:
    def __init__(self, seed: int, size: int, traits: Collection[Trait]) -> None:
        self._seed, self._size, self._traits = seed, size, traits
        self._draw = draw = Random(f"system {seed} {size}")
        self._kinds = Kinds(draw)
        self._depth = 0
        self._channels: list[Channel] = []
        self._machines: list[Machine] = []
        self._beats: dict[str, int] = {}
        self._leaves: list[Leaf] = []
        self._plugins: list[Model] = []
        self._bound: list[Element] = []
        self._plain: set[str] = set()

    def _next_depth(self) -> int:
        self._depth += 1
        return self._depth

    def plan(self) -> Plan:
        """All of it."""
        draw, size = self._draw, self._size
        names = [f"Part{number}" for number in range(size + 1)]
        for name in names:
            self._offers(name)
        for name in names:
            self._component(name)
        for channel in self._channels:
            self._connect(channel)
        policy = self._policy() if size > 1 and happens(draw, "policy") else None
        models = [self._model(machine) for machine in self._machines]
        promises = Promises(draw, self._channels)
        if happens(draw, "properties"):
            promises.draw_some(draw.randint(3, 4 + 2 * size))
        qualities = [
            e("topic", name=item.name, reliability="best_effort")
            for item in self._channels
            if item.kind == "topic" and happens(draw, "best effort")
        ]
        return Plan(
            self._seed,
            size,
            (*models, *self._plugins),
            self._kinds.definitions(),
            self._kinds.declarations(),
            policy,
            draw.choice((2.0, 4.0, 5.0, 10.0)),
            promises.ports,
            tuple(promises.stated),
            tuple(qualities),
            tuple(self._bound),
        )

    # -- components -------------------------------------------------------------------------------

    def _offers(self, owner: str) -> None:
        """What a component offers, before anybody is made who uses it."""
        for number in range(self._draw.randint(1, 2)):
            kind = pick(self._draw, COMPONENTS)
            taken = [item for item in self._channels if item.owner == owner and item.kind == kind]
            if kind == "action" and taken:
                continue
            depth = self._next_depth()
            match kind:
                case "topic":
                    made = Channel(
                        f"/{owner}/topic{number}",
                        kind,
                        owner,
                        depth,
                        message=self._draw.choice(self._kinds.messages),
                    )
                case "service":
                    service = self._draw.choice(self._kinds.services)
                    made = Channel(f"/{owner}/ask{number}", kind, owner, depth, service=service)
                case "action":
                    action = self._draw.choice(self._kinds.actions)
                    made = Channel(f"/{owner}/work{number}", kind, owner, depth, action=action)
                case _:
                    made = Channel(
                        f"{owner.lower()}.event{number}", kind, owner, depth, message=EVENT
                    )
            self._channels.append(made)

    def _component(self, name: str) -> None:
        draw = self._draw
        machine = Machine(draw, self._kinds, name, happens(draw, "draws at random"))
        self._machines.append(machine)
        rate_hz = draw.choice((1, 2, 4)) * (5 if Trait.FAST in self._traits else 1)
        self._beats[name] = beat = machine.timer("beat", rate_hz)
        for number in range(draw.randint(1, 2) if Trait.IN_STEP in self._traits else 0):
            machine.pulse(f"pulse{number}", rate_hz * draw.choice((0.5, 1, 2)))
        for channel in self._channels:
            if channel.owner == name:
                offer(machine, channel, beat)
        if draw.random() < 0.5:
            machine.note(self._next_depth())
        if draw.random() < 0.5:
            machine.later(self._next_depth())
        if happens(draw, "chain of raised events"):
            start = machine.timer("slow", 0.5)
            machine.chain(start, self._next_depth())
        serves = any(c.owner == name and c.kind in ("service", "action") for c in self._channels)
        if not serves and happens(draw, "final state"):
            machine.final_after_s = draw.choice((4, 8))

    def _connect(self, channel: Channel) -> None:
        """Somebody uses it, often two."""
        others = [item for item in self._machines if item.name != channel.owner]
        count = 1 + (self._draw.random() < 0.35)
        for machine in self._draw.sample(others, min(count, len(others))):
            use(machine, channel, self._beats[machine.name])

    # -- the tree ---------------------------------------------------------------------------------

    def _policy(self) -> Element:
        draw = self._draw
        for number in range(draw.randint(2, self._size + 1)):
            make_one = action if draw.random() < 0.5 else condition
            spelling = Spelling.PLAIN if happens(draw, "plain") else Spelling.HL_SCXML
            kinds = (
                ("service", "topic")
                if spelling is Spelling.PLAIN
                else ("service", "topic", "event", "action")
            )
            able = [item for item in self._channels if item.kind in kinds]
            uses = draw.sample(able, min(len(able), draw.randint(1, 2)))
            machine, leaf = make_one(draw, self._kinds, number, uses, spelling)
            if spelling is Spelling.PLAIN:
                self._plain.add(machine.name)
            self._machines.append(machine)
            self._leaves.append(leaf)
        for number in range(draw.randint(0, 2)):
            model, leaf = plugin(draw, number)
            self._plugins.append(model)
            self._leaves.append(leaf)
        for binding, leaf in bound(draw, self._channels) if Trait.BOUND in self._traits else ():
            self._bound.append(binding)
            self._leaves.append(leaf)
        wraps = [decorator(draw, number) for number in range(draw.randint(0, 2))]
        around, nav2 = [item.name for item in wraps], Trait.NAV2 in self._traits
        tree = Tree(draw, self._leaves, around, nav2).root()
        named = {item.get("ID") for item in tree.all()}
        self._plugins += [item for item in wraps if item.name in named]
        return tree

    def _model(self, machine: Machine) -> Model:
        root = machine.root()
        if machine.name in self._plain and can_be_plain(root):
            return Model(machine.name, plain(root), Spelling.PLAIN)
        ascxml = happens(self._draw, "ascxml")
        return Model(machine.name, root, Spelling.ASCXML if ascxml else Spelling.HL_SCXML)


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description="Write a system made at random.")
    parser.add_argument("seed", type=int)
    parser.add_argument("size", type=int, nargs="?", default=2, choices=SIZES)
    parser.add_argument("folder", type=Path)
    chosen = parser.parse_args()
    print(write(make(chosen.seed, chosen.size), chosen.folder))


if __name__ == "__main__":
    main()

__all__ = ["SIZES", "make", "reductions", "write"]
