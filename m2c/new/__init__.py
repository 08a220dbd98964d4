"""Beginning: a system that runs at once, and models that are wired into a system (``m2c new``)."""
