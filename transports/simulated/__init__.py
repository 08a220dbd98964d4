"""A deterministic middleware in virtual time."""
