"""What fuzzing once found stays found."""

from __future__ import annotations

import pytest

from tests.properties.soak import CORPUS, fuzz, read


@pytest.mark.parametrize("path", sorted(CORPUS.iterdir()), ids=lambda path: path.name)
def test_an_entry_of_the_corpus_neither_crashes_nor_hangs(path):
    read(path.suffix, path.read_text())


def test_a_short_fuzzing_run_finds_nothing():
    assert fuzz(seconds=3.0, seed=1) == 0
