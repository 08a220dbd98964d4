"""A pytest plugin: ``moon`` as it is written, also where it was compiled (``pytest -p tests.interpreted …``)."""

from __future__ import annotations

import importlib.machinery
import sys
from pathlib import Path

PACKAGE = Path(__file__).parents[1] / "moon"


def _sources_only(folder: str) -> importlib.machinery.FileFinder:
    """A finder for the folders of ``moon`` that does not know extension modules."""
    if not Path(folder).is_relative_to(PACKAGE):
        raise ImportError("not a folder of moon")
    loaders = (importlib.machinery.SourceFileLoader, importlib.machinery.SOURCE_SUFFIXES)
    return importlib.machinery.FileFinder(folder, loaders)


sys.path_hooks.insert(0, _sources_only)
sys.path_importer_cache.clear()
