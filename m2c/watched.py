"""Which of a system's files have changed: what ``--watch`` looks at twice a second.

A handful of files is looked at, by their times and sizes: no service of the operating system is needed, and
network file systems and mounts of containers, which send no events, are watched too.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from m2c.model.system import MODEL_SUFFIXES, System
from m2c.policy.includes import included_in

PERIOD_S = 0.5
"""How often the files are looked at. What has changed is taken once it stays as it is for so long: an editor
may write a file in several steps."""
DEFINITIONS = (".msg", ".srv", ".action", ".idl")

_Stamps = dict[Path, tuple[int, int]]


class WatchedFiles:
    """The files that some paths, and a system that was read from them, consist of.

    Args:
        paths: models, folders of models, folders of interface packages, a system file, a policy.
    """

    def __init__(self, paths: Sequence[Path]) -> None:
        self._paths = tuple(paths)
        self._more: tuple[Path, ...] = ()
        self._handled = self._seen = self._look()

    def follow(self, system: System | None) -> None:
        """From now on, look at the files of ``system``, too; None: at those of the one before.

        What has changed since the last look is not lost.
        """
        followed = set(_files((*self._paths, *self._more)))
        if system is not None:
            trees = included_in(system.policy) if system.policy is not None else ()
            self._more = (*system.sources, *trees, *system.library.folders)
        now = self._look()
        for known in (self._handled, self._seen):
            for path in now.keys() - known.keys() - followed:
                known[path] = now[path]
            for path in [path for path in known.keys() - now.keys() if path.exists()]:
                del known[path]  # the system has it no more

    def changed(self) -> list[Path]:
        """The files that were changed, made or removed since they were told last, and are at rest; sorted."""
        now = self._look()
        at_rest, self._seen = now == self._seen, now
        if not at_rest:
            return []
        before, self._handled = self._handled, dict(now)
        differing = (
            path for path in now.keys() | before.keys() if now.get(path) != before.get(path)
        )
        return sorted(differing)

    def _look(self) -> _Stamps:
        found: _Stamps = {}
        for path in _files((*self._paths, *self._more)):
            try:
                status = path.stat()
            except OSError:  # it is being replaced, or was removed
                continue
            found[path] = (status.st_mtime_ns, status.st_size)
        return found


def _files(paths: Iterable[Path]) -> Iterator[Path]:
    for path in paths:
        if path.is_dir():
            kinds = (*MODEL_SUFFIXES, ".xml", *DEFINITIONS)
            yield from (inner.resolve() for inner in path.rglob("*") if inner.suffix in kinds)
        else:
            yield path.resolve()


def named(files: Sequence[Path]) -> str:
    """``files`` in a line."""
    names = ", ".join(path.name for path in files)
    return f"{names} {'has' if len(files) == 1 else 'have'} changed"
