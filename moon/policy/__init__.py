"""Monitoring of behaviour-tree policies: whether what is ticked is what the tree would tick."""

from moon.policy.oracle import PolicyOracle
from moon.policy.places import leaf_places

__all__ = ["PolicyOracle", "leaf_places"]
