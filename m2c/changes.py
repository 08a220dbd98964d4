"""How a command line, or who calls the API, changes the models that are read."""

from __future__ import annotations

from typing import NamedTuple


class Changes(NamedTuple):  # msgspec's would cost each --help its import
    """How the models that are read are changed; see :mod:`m2c.model.overrides`.

    Attributes:
        lenient: strings, numbers and bools become one another (docs/values.md).
        parameters: what variables of nodes begin with.
        remaps: channels that take the place of nodes' own.
    """

    lenient: bool = False
    parameters: tuple[str, ...] = ()
    remaps: tuple[str, ...] = ()

    def words(self) -> list[str]:
        """The command line that says the same."""
        words = ["--lenient"] if self.lenient else []
        words += [word for text in self.parameters for word in ("--param", text)]
        return words + [word for text in self.remaps for word in ("--remap", text)]


UNCHANGED = Changes()
