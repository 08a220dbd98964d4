"""Memory for keys that come from the wire has an end."""

from __future__ import annotations

from transports.bounded import BoundedDict


def test_of_more_than_its_most_it_forgets_the_key_that_it_got_first() -> None:
    kept: BoundedDict[str, int] = BoundedDict(2)
    kept["a"] = 1
    kept["b"] = 2
    kept["a"] = 3
    assert kept == {"a": 3, "b": 2}
    kept["c"] = 4
    assert kept == {"b": 2, "c": 4}
