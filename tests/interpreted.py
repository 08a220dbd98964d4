"""A pytest plugin: ``moon`` and ``transports`` as they are written, also where they were compiled
(``pytest -p tests.interpreted …``).
"""

from __future__ import annotations

import importlib.machinery
import sys
from pathlib import Path

PACKAGES = [Path(__file__).parents[1] / name for name in ("moon", "transports")]


def _sources_only(folder: str) -> importlib.machinery.FileFinder:
    """A finder for the folders of both that does not know extension modules."""
    if not any(Path(folder).is_relative_to(package) for package in PACKAGES):
        raise ImportError("not a folder of theirs")
    loaders = (importlib.machinery.SourceFileLoader, importlib.machinery.SOURCE_SUFFIXES)
    return importlib.machinery.FileFinder(folder, loaders)


sys.path_hooks.insert(0, _sources_only)
sys.path_importer_cache.clear()
