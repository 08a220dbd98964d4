"""The attacks on a live lab tour on Zenoh: bounded in ``make test``, for an hour in ``make soak``."""
