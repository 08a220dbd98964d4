"""The ROS 2 part of the suite, again and again: all green, and no segment left in shared memory.

``python -m tests.transports.ros2_soak [TIMES] [PYTEST ARGUMENTS…]``; by default 20 times everything marked
``ros2``. Ends with 1 at the first run that fails, or at the end if any left something. All runs have one
shared memory, of their own where that is permitted; else nobody else should use ROS 2 at the same time.
"""

from __future__ import annotations

import subprocess
import sys

from tests.transports.shared_memory import SHARED, left_over, segments, separate

TIMES = 20
RUN_TIMEOUT_S = 1800.0
"""A run that takes longer hangs."""


def main(arguments: list[str]) -> int:
    """Run it; the exit code."""
    times = int(arguments[0]) if arguments else TIMES
    command = [sys.executable, "-m", "pytest", "-q", "-m", "ros2", *arguments[1:]]
    separate()
    before = segments()
    leaks = 0
    for number in range(1, times + 1):
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=RUN_TIMEOUT_S, check=False
        )
        print(f"{number}: {done.stdout.splitlines()[-1]}", flush=True)
        if done.returncode:
            print(done.stdout)
            return 1
        if left := left_over(before):
            print(f"left in {SHARED}: {', '.join(sorted(left))}", flush=True)
            before |= left
            leaks += 1
    if leaks:
        print(f"{leaks} of {times} runs left something")
        return 1
    print(f"{times} runs, all green, no segment left in {SHARED}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
