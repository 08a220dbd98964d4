"""When a tap receives all that there is.

Subscriptions take effect one after the other: in the middle of a run a tap receives an answer before it can
receive the question.
"""

from __future__ import annotations

from collections.abc import Callable

from transports.interface import Listener, Tap

LOOK_S = 0.02
"""How often it is looked whether the tap is complete."""
AT_MOST_S = 15.0
"""Nobody waits longer for a graph that goes on changing."""


def when_complete(
    connection: Listener, tap: Tap, begin: Callable[[], None], give_up: Callable[[], None]
) -> None:
    """Call ``begin`` once, when ``tap`` receives everything; at once, if it does already.

    Args:
        connection: the tap's, of whose executor this is called.
        tap: which.
        begin: what then begins.
        give_up: called first if that is not so within :data:`AT_MOST_S`; then it begins all the same.
    """
    if tap.is_complete:
        begin()
        return
    left = round(AT_MOST_S / LOOK_S)  # the time of day may be set meanwhile

    def look() -> None:
        nonlocal left
        left -= 1
        is_complete = tap.is_complete
        if not is_complete and left > 0:
            return
        timer.cancel()
        if not is_complete:
            give_up()
        begin()

    timer = connection.every(LOOK_S, look)
