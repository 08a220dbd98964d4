"""Discrete time: one call a step, bounds counted in steps."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from moon.properties.binding import bind
from moon.properties.compiler import compile_network
from moon.properties.formula import Formula
from moon.properties.network import build_network
from moon.properties.predicates import UNKNOWN_ERRORS, PredicateError, why_unknown
from moon.properties.syntax import parse_formula


class StepMonitor:
    """Monitors a formula over evenly spaced steps; ``[a:b]`` counts steps.

    ``since`` has its usual meaning here: the step at which its right side holds counts itself.

    Args:
        formula: the formula, or its text.

    Raises:
        FormulaError: the text is not a formula.
        PredicateError: a predicate that cannot be evaluated.
    """

    def __init__(self, formula: Formula | str) -> None:
        if isinstance(formula, str):
            formula = parse_formula(formula, ticks_per_unit=1)
        self._evaluate = bind([formula], ()).evaluate
        network = build_network([formula], in_steps=True)
        self._program = compile_network(network)
        self._nodes = {
            node.text: f"p{index}"
            for index, node in enumerate(network.nodes)
            if node.kind == "atom"
        }
        self._values: dict[str, Any] = {}
        self.now = -1
        """The step of the last call; -1 before the first."""

    def step(self, values: Mapping[str, Any]) -> bool:
        """One more step, with new ``values`` by name (others keep theirs); whether it holds now.

        Raises:
            PredicateError: a predicate has no value (a name never given, a NaN, another type); the
                step did not happen.
        """
        known = {**self._values, **values}
        try:
            atoms = {name: self._evaluate[text](known) for text, name in self._nodes.items()}
        except UNKNOWN_ERRORS as error:
            raise PredicateError(why_unknown(error)) from error
        self._values = known
        self.now += 1
        self._program.before(self.now)
        self._program.write({**atoms, "now": self.now})
        self._program.step(self.now)
        return bool(self._program.values()[0])
