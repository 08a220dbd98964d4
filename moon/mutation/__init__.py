"""First-order mutants of machines: how the oracle's power to detect is measured."""

from moon.mutation.equivalence import equivalence
from moon.mutation.operators import OPERATORS, Mutant, mutants

__all__ = ["OPERATORS", "Mutant", "equivalence", "mutants"]
