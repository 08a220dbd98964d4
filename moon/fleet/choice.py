"""Which robots of a fleet a monitor takes: the namespaces that match a pattern, or a share of them."""

from __future__ import annotations

import hashlib
import re
from typing import NamedTuple

_ILLEGAL = "$#?"
"""Zenoh's own signs, of which no key has any."""
_SHARD = re.compile(r"([1-9][0-9]{0,5})/([1-9][0-9]{0,5})")


class ChoiceError(ValueError):
    """A pattern or a share that is none; the text says what would be right."""


def fleet_pattern(text: str) -> str:
    """``text`` as a pattern of namespaces, without slashes at its ends.

    It has parts with ``/`` between them; ``*`` stands for anything within one part.

    Raises:
        ChoiceError: it is none.
    """
    pattern = text.strip("/")
    wrong = ""
    if not pattern:
        wrong = "it is empty"
    elif "" in pattern.split("/"):
        wrong = "it has an empty part"
    elif "**" in pattern:
        wrong = "'*' stands for anything within one part, and '**' for nothing"
    elif bad := next((c for c in pattern if c in _ILLEGAL or not c.isprintable()), ""):
        wrong = f"{bad!r} is not allowed in it"
    elif any(part.startswith("@") for part in pattern.split("/")):
        wrong = "a part may not start with '@'"
    if wrong:
        raise ChoiceError(f"{text!r} is no pattern of namespaces, as robots/* is: {wrong}")
    return pattern


class Shard(NamedTuple):
    """Share ``number`` (from 1) of the ``of`` shares of a fleet.

    A robot belongs to the share that a hash of its name says. So those who take a share each need not know of
    one another, together they take every robot, and no robot is taken twice.
    """

    number: int
    of: int

    def takes(self, robot: str) -> bool:
        """Whether the robot in namespace ``robot`` belongs to it."""
        digest = hashlib.blake2b(robot.encode(), digest_size=8).digest()
        return int.from_bytes(digest, "big") % self.of == self.number - 1

    def __str__(self) -> str:
        return f"{self.number}/{self.of}"


WHOLE = Shard(1, 1)
"""All robots."""


def read_shard(text: str) -> Shard:
    """``K/N``, the share ``K`` of ``N``.

    Raises:
        ChoiceError: it is none.
    """
    found = _SHARD.fullmatch(text)
    if found is None or int(found[1]) > int(found[2]):
        raise ChoiceError(
            f"{text!r} is no share: write K/N with K from 1 to N, as 2/4 for the second of four"
        )
    return Shard(int(found[1]), int(found[2]))
