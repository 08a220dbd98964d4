"""A healthy run that is cut anywhere: what the oracle takes up again must contain what truly goes on.

A system made at random (``tests.campaign.systems``) runs in virtual time. All that happens is known, and after
each event the true state and data of each machine. Of each machine some oracles are given all that happened;
at some moment something is missing, as they are told, and they begin anew; or they are given nothing that
happened before. After each thing that the machine
then does, one hypothesis must be what the machine truly is, there are no more than are to be followed, and no
oracle may say that it is violated.

``python -m tests.oracle.cuts FIRST COUNT`` tries so many systems, and prints each contradiction.
"""

from __future__ import annotations

import argparse
import logging
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from typing import Any

import msgspec

from m2c.codegen.context import MachineContext
from m2c.codegen.names import machine_class
from m2c.codegen.ports import PortNames
from m2c.model.machine import InterfaceKind, Machine
from m2c.model.system import System
from m2c.simulation.program import compile_system
from m2c.simulation.run import SimulatedRun
from moon.oracle.bounds import Bounds, TooManyError
from moon.oracle.oracle import Oracle
from moon.oracle.program import Program
from moon.oracle.state import Hypothesis
from moon.oracle.steps import TooOpenError
from moon.verdict import Outcome
from tests.campaign.differential import allows, plain
from tests.campaign.plans import read
from tests.campaign.systems import SIZES, make, write
from transports.interface import Observation, ObservationKind
from transports.simulated import Conditions, SimulatedWorld
from transports.simulated.world import START_NS

SECONDS = 7.0
CUTS = 3
"""So often is a run cut, for each machine."""
_LINKS_S = ((0.0, 0.0), (0.0, 0.02), (0.0, 0.2), (0.0, 0.5))
_MOST = (8, 32, 128, 512)
"""So many hypotheses are followed: where there are more, the oracle follows them with fewer."""
_LOOK_NS = 20_000_000
"""A node says at least so often that it has done nothing more."""
_TAKEN = (
    ObservationKind.REQUEST_RECEIVED,
    ObservationKind.RESPONSE_RECEIVED,
    ObservationKind.MESSAGE_TAKEN,
)

_OF_GOALS = (InterfaceKind.ACTION_SERVER, InterfaceKind.ACTION_CLIENT)

Instance = tuple[str, tuple[Any, ...]]
"""State and datamodel of a machine, or of one of its threads."""


class Run(msgspec.Struct, frozen=True):
    """What happened, and what the machines were then.

    Attributes:
        seen: all that happened, in order.
        true: of each machine, its instances after so many of these.
        end_ns: when it ended.
    """

    seen: tuple[Observation, ...]
    true: dict[str, dict[int, tuple[Instance, ...]]]
    end_ns: int


class Contradiction(msgspec.Struct, frozen=True):
    """What the oracle of a machine does not believe.

    Attributes:
        machine: its name.
        cut: something is missing after so many observations; 0: nothing is.
        most: so many hypotheses are followed.
        at_s: when, since the begin of the run.
        text: what the machine truly is, or of what it is accused.
    """

    machine: str
    cut: int
    most: int
    at_s: float
    text: str

    def __str__(self) -> str:
        return f"{self.machine}, cut {self.cut}, {self.most} followed, at {self.at_s:.6f} s: {self.text}"


# --- the run --------------------------------------------------------------------------------------


class Watched:
    """The instances of one machine of a run.

    Args:
        machine: the model.
        system: its system.
        node: its node, which runs the generated code.
    """

    def __init__(self, machine: Machine, system: System, node: Any) -> None:
        names = PortNames(machine, system.library)
        self._read: list[tuple[Any, list[str]]] = [
            (node.machine, self._attributes(machine, system, names))
        ]
        name = machine_class(machine.name)
        lists = [made for key, made in vars(node).items() if key.startswith("_threads_")]
        for number, thread in enumerate(machine.threads):
            wanted = f"{name}Thread{number + 1 if number else ''}"
            found = next(made for made in lists if made and type(made[0]).__name__ == wanted)
            attributes = self._attributes(thread.machine, system, names)
            self._read += [(made, attributes) for made in found]

    @staticmethod
    def _attributes(machine: Machine, system: System, names: PortNames) -> list[str]:
        context = MachineContext(machine, system.library, names, {}, "")
        return [context.attribute(data.name) for data in machine.data]

    def now(self) -> tuple[Instance, ...]:
        """Their states and data."""
        return tuple(
            (made.state.value, tuple(plain(getattr(made, name)) for name in names))
            for made, names in self._read
        )


def run(system: System, seed: int) -> Run:
    """Run ``system`` under random delays."""
    draw = Random(f"cuts {seed}")
    world = SimulatedWorld(seed, Conditions(delay_s=draw.choice(_LINKS_S)))
    seen: list[Observation] = []
    world.witness(seen.append)
    nodes = SimulatedRun(compile_system(system), world)
    watched = {
        machine.name: Watched(machine, system, nodes.nodes[machine.name])
        for machine in system.nodes
    }
    true: dict[str, dict[int, tuple[Instance, ...]]] = {name: {} for name in watched}
    noted = 0

    def note() -> bool:
        nonlocal noted
        for name in {one.source for one in seen[noted:]} & watched.keys():
            true[name][len(seen)] = watched[name].now()
        noted = len(seen)
        return False

    nodes.run(SECONDS, note)
    world.close()
    return Run(tuple(seen), true, world.now_ns)


# --- the oracle -----------------------------------------------------------------------------------


def contradictions(system: System, seed: int, cuts: int = CUTS) -> Iterator[Contradiction]:
    """Where oracles do not believe a run of ``system``: of each machine and cut the first."""
    happened = run(system, seed)
    draw = Random(f"cut {seed}")
    for machine in system.nodes:
        if not any(one.kind in _OF_GOALS for one in machine.interfaces):
            continue
        program = Program(machine, system.library)
        for number in range(cuts):
            cut = draw.randrange(len(happened.seen)) if number else 0
            joins = bool(cut) and draw.random() < 0.5
            follower = Follower(machine, system, program, happened, cut, draw.choice(_MOST), joins)
            found = follower.contradiction()
            if found is not None:
                yield found


class Follower:
    """One oracle that follows a run.

    Args:
        machine: the model.
        system: its system.
        program: the machine, ready to be stepped.
        happened: the run.
        cut: something is missing after so many observations; 0: nothing is.
        most: so many hypotheses are followed.
        joins: nothing is given to the oracle that happened before the cut.
    """

    def __init__(
        self,
        machine: Machine,
        system: System,
        program: Program,
        happened: Run,
        cut: int,
        most: int,
        joins: bool = False,
    ) -> None:
        self._joins = joins
        self._machine, self._program, self._happened = machine, program, happened
        self._cut, self._most = cut, most
        bounds = Bounds(hypotheses=most)
        self.oracle = Oracle(
            machine, system.library, bounds=bounds, program=program, synchronised=not joins
        )
        if not joins:
            self.oracle.start(START_NS)
        self.checked = 0
        """How often the machine was found among the hypotheses."""

    def contradiction(self) -> Contradiction | None:
        """The first; None: there is none."""
        name, oracle, happened = self._machine.name, self.oracle, self._happened
        own, looked_ns = 0, START_NS
        told: list[Any] = []
        for count, one in enumerate(happened.seen, 1):
            if self._joins and count <= self._cut:
                own = one.order + 1 if one.source == name else own
                looked_ns = one.stamp_ns
                if count == self._cut:
                    oracle.listen(looked_ns)
                continue
            if one.stamp_ns > looked_ns + _LOOK_NS:
                looked_ns = one.stamp_ns - 1
                told += oracle.reported(own, looked_ns, looked_ns)
                told += oracle.advance(looked_ns)
            if one.source == name:
                own = one.order + 1
            if one.source == name or oracle.concerns(one.channel, one.source, one.kind):
                told += oracle.feed(one)
            if count == self._cut:
                told += oracle.lose(one.stamp_ns, "it is cut here")
            wrong = [said.reason for said in told if said.outcome is Outcome.VIOLATED]
            if wrong:
                return self._contradiction(one.stamp_ns, wrong[0])
            told.clear()
            if len(oracle.hypotheses) > self._most:
                followed = f"{len(oracle.hypotheses)} hypotheses are followed"
                return self._contradiction(one.stamp_ns, followed)
            is_judged = oracle.judge.search.last == one.stamp_ns  # else it waits for what is before
            is_checked = is_judged and count in happened.true[name] and one.source == name
            if is_checked and oracle.is_synchronised and one.kind in _TAKEN + _SENT:
                true = happened.true[name][count]
                if not self._is_believed(true, one.stamp_ns):
                    return self._contradiction(one.stamp_ns, f"not {true} after {one}")
        return None

    def _contradiction(self, stamp_ns: int, text: str) -> Contradiction:
        at_s = (stamp_ns - START_NS) / 1e9
        return Contradiction(self._machine.name, self._cut, self._most, at_s, text)

    def _is_believed(self, true: Sequence[Instance], stamp_ns: int) -> bool:
        search = self.oracle.judge.search
        known = self.oracle.hypotheses
        try:
            found = search.reachable(known, stamp_ns + 1, stamp_ns - search.bounds.latency)
        except (TooManyError, TooOpenError):
            return True
        self.checked += 1
        return any(self._is(hypothesis, true) for hypothesis in found)

    def _is(self, hypothesis: Hypothesis, true: Sequence[Instance]) -> bool:
        """Whether ``hypothesis`` is, or may turn out to be, what is true."""
        if any(not owed.optional for owed in hypothesis.owed):
            return False
        return all(
            part.states[state].name == true_state
            and all(
                name not in part.live or allows(value, its)
                for name, value, its in zip(part.names, data, true_data, strict=True)
            )
            for part, (state, data), (true_state, true_data) in zip(
                self._program.parts, hypothesis.instances, true, strict=True
            )
        )


_SENT = (ObservationKind.MESSAGE, ObservationKind.REQUEST_SENT, ObservationKind.RESPONSE_SENT)


def contradictions_of(seed: int, size: int, folder: Path, cuts: int = CUTS) -> list[Contradiction]:
    """Those of the system of a seed."""
    return list(contradictions(read(write(make(seed, size), folder)), seed, cuts))


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description="Follow healthy runs that are cut anywhere.")
    parser.add_argument("first", type=int)
    parser.add_argument("count", type=int)
    parser.add_argument("--size", type=int, choices=SIZES, default=2)
    parser.add_argument("--cuts", type=int, default=CUTS)
    chosen = parser.parse_args()
    logging.disable(
        logging.CRITICAL
    )  # what generated machines log of failing expressions is theirs
    wrong = 0
    for seed in range(chosen.first, chosen.first + chosen.count):
        with TemporaryDirectory() as folder:
            found = contradictions_of(seed, chosen.size, Path(folder), chosen.cuts)
        wrong += bool(found)
        for item in found:
            print(f"seed {seed}: {item}", flush=True)
    print(f"{chosen.count} systems from seed {chosen.first}, {wrong} not believed")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
