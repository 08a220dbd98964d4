"""What a tap makes of a message of which little is read: what is read, and the beginning of the rest."""

from __future__ import annotations

import random
import tracemalloc
from typing import Any

import msgspec
import pytest

from transports.fields_read import UNREAD_KEPT, Paths, inside, kept
from transports.payloads import MOST_DEPTH, SMALL_BYTES, PayloadError, plain

NAMES = "abcd"


def beginning(value: Any, read: Paths | None) -> Any:
    """``value``, of which ``read`` is read, cut off where it may be."""
    if read is None:
        return value
    if isinstance(value, dict):
        return {name: beginning(part, inside(read, name)) for name, part in value.items()}
    if isinstance(value, list):
        return [beginning(part, read) for part in value[: kept(read)]]
    return value


def some_value(rng: random.Random, depth: int) -> Any:
    choice = rng.random()
    if not depth or choice < 0.2:
        return rng.choice([1, -5, 2.5, "x" * rng.choice([0, 3, 500]), True, None, 2**63, b"\0"])
    if choice < 0.6:
        count = rng.choice([0, 1, 16, UNREAD_KEPT - 1, UNREAD_KEPT, UNREAD_KEPT + 1])
        made = [some_value(rng, depth - 1) for _ in range(3)] or [0]
        return [rng.choice(made) for _ in range(count)]
    return {name: some_value(rng, depth - 1) for name in NAMES if rng.random() < 0.8}


@pytest.mark.parametrize("seed", range(60))
def test_all_that_is_read_is_there_and_the_beginning_of_what_is_not(seed: int):
    rng = random.Random(seed)
    value = {**{name: some_value(rng, 2) for name in NAMES}, "e": "x" * SMALL_BYTES}
    paths = [tuple(rng.choices(NAMES, k=rng.randrange(1, 4))) for _ in range(rng.randrange(3))]
    read = frozenset(paths)
    made = plain(msgspec.msgpack.encode(value), read)
    assert beginning(made, read) == beginning(value, read)
    for name in NAMES:
        if not inside(read, name) and isinstance(value[name], list) and len(str(made)) > 10**4:
            assert len(made[name]) <= UNREAD_KEPT or inside(read, name) is None


@pytest.mark.parametrize(
    "element", [200, 2.5, "text", {"x": 1.5, "y": 2.5}, [1, 2]], ids=lambda e: type(e).__name__
)
@pytest.mark.parametrize("place", ["on top", "within", "in each of few"])
def test_what_is_not_read_takes_no_memory(element: Any, place: str):
    many = [element] * 200_000
    message: dict[str, Any] = {"number": 3, "many": many, "after": 4}
    if place == "within":
        message = {"number": 3, "inner": {"inner": message}}
    elif place == "in each of few":
        message = {"number": 3, "few": [message, message]}
    payload = msgspec.msgpack.encode(message)
    read = frozenset({("number",), ("few", "number")})
    tracemalloc.start()
    try:
        made = plain(payload, read)
        assert tracemalloc.get_traced_memory()[1] < 600_000
    finally:
        tracemalloc.stop()
    assert made == beginning(message, read)


def test_few_bytes_are_decoded_whole():
    message = {"number": 3, "many": [1] * 1000}
    assert plain(msgspec.msgpack.encode(message), frozenset()) == message


def test_what_is_nested_too_deep_is_refused_wherever_it_is():
    deep: Any = "x"
    for _ in range(MOST_DEPTH):
        deep = {"a": [deep]}
    for read in (frozenset(), frozenset({("a",)}), frozenset({("b", "c")})):
        with pytest.raises(PayloadError, match="nested deeper than 128"):
            plain(msgspec.msgpack.encode({"fill": "x" * SMALL_BYTES, "b": [deep]}), read)
