"""Running colcon: what it wrote at its end, and how far it is meanwhile."""

from __future__ import annotations

import collections
import re
import subprocess
import threading
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

Tell = Callable[[str], None]
"""What is called with each line that says how far a build is."""
SHOWN_LINES = 25
"""Of what colcon and its tools write: the fault is at the end."""
_PROGRESS = re.compile(r"\s*(Starting >>>|Finished <<<|Failed\s+<<<|Aborted\s+<<<)")


def followed(
    command: Sequence[str],
    environment: Mapping[str, str],
    folder: Path,
    tell: Tell,
    limit_s: float,
) -> tuple[int | None, tuple[str, ...]]:
    """Run colcon.

    Args:
        command: its command line.
        environment: its environment variables.
        folder: where it runs.
        tell: gets the lines that say which package is begun or finished, as they are written.
        limit_s: seconds after which it is killed.

    Returns:
        Its exit code, None if it was killed, and the last lines that it wrote.
    """
    written: collections.deque[str] = collections.deque(maxlen=SHOWN_LINES)
    is_over = threading.Event()
    with subprocess.Popen(
        command,
        env=environment,
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors="replace",
    ) as process:

        def end() -> None:
            is_over.set()
            process.kill()

        limit = threading.Timer(limit_s, end)
        limit.start()
        assert process.stdout is not None
        try:
            for line in process.stdout:
                written.append(line.rstrip())
                if _PROGRESS.match(line):
                    tell(line.strip())
            code = process.wait()
        finally:  # who reads the lines may be gone
            limit.cancel()
    return None if is_over.is_set() else code, tuple(written)
