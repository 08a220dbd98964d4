"""Run a generated system: one process per node, and the policy."""
