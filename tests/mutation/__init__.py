"""First-order mutants of machines: how the oracle's power to detect is measured."""

from tests.mutation.equivalence import equivalence
from tests.mutation.operators import OPERATORS, Mutant, mutants

__all__ = ["OPERATORS", "Mutant", "equivalence", "mutants"]
