"""Many hostile models, for hours: ``python -m tests.hostile.soak 20000 [--seed N]``.

Prints progress, and the files of the first model that fails, made as small as may be. Exit code 1 then.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import traceback
from collections import Counter
from pathlib import Path

from hypothesis import HealthCheck, Phase, given, seed, settings

from tests.hostile.importing import import_all
from tests.hostile.judging import Accepted, judge
from tests.hostile.models import Case, cases

BATCH = 500
"""Models between two lines of progress; so many are imported together."""


class _Soak:
    def __init__(self) -> None:
        self.seen = 0
        self.last: Case | None = None
        self.waiting: list[Accepted] = []
        self.refusals: Counter[str] = Counter()

    def judge(self, case: Case) -> None:
        self.last = case
        found = judge(case)
        self.seen += 1
        if isinstance(found, Accepted):
            self.waiting.append(found)
        else:
            self.refusals[", ".join(found.rules) or "no file can hold it"] += 1
        if self.seen % BATCH == 0:
            self.finish_batch()

    def finish_batch(self) -> None:
        """Import what was accepted since the last time."""
        with tempfile.TemporaryDirectory() as scratch:
            import_all(self.waiting, Path(scratch))
        self.waiting.clear()
        refused = sum(self.refusals.values())
        print(f"{self.seen} models, {self.seen - refused} accepted", flush=True)


def main(arguments: list[str]) -> int:
    """Judge as many models as ``arguments`` say; the exit code."""
    parser = argparse.ArgumentParser(prog="tests.hostile.soak", description=__doc__)
    parser.add_argument("models", type=int)
    parser.add_argument("--seed", type=int, default=0)
    given_options = parser.parse_args(arguments)
    soak = _Soak()

    @seed(given_options.seed)
    @settings(
        max_examples=given_options.models,
        deadline=None,
        database=None,
        phases=[Phase.generate, Phase.shrink],
        report_multiple_bugs=False,
        suppress_health_check=list(HealthCheck),
    )
    @given(case=cases())
    def judged(case: Case) -> None:
        soak.judge(case)

    try:
        judged()
        soak.finish_batch()
    except Exception as error:  # whatever goes wrong, the model that made it go wrong is shown
        print("".join(traceback.format_exception_only(error)))
        if soak.last is not None:
            print(f"{soak.last!r}\n")
            for path, content in soak.last.files().items():
                print(f"--- {path}\n{content.decode('utf-8', 'backslashreplace')}\n")
        return 1
    for rules, count in soak.refusals.most_common():
        print(f"{count:6d} refused: {rules}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
