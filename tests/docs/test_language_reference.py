"""The language reference names everything that the reader accepts or refuses."""

from pathlib import Path

import pytest

from m2c.model.vocabulary import ATTRIBUTES, UNSUPPORTED

REFERENCE = (Path(__file__).parents[2] / "docs" / "language.md").read_text()


@pytest.mark.parametrize("tag", sorted({*ATTRIBUTES, *UNSUPPORTED}))
def test_the_reference_names_the_tag(tag: str) -> None:
    assert f"`{tag}`" in REFERENCE
