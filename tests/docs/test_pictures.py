"""The committed pictures are what their script draws from today's models."""

from __future__ import annotations

import runpy
from pathlib import Path
from xml.etree import ElementTree

import pytest

IMAGES = Path(__file__).parents[2] / "docs" / "images"
DRAWN: dict[str, str] = runpy.run_path(str(IMAGES / "examples.py"))["pictures"]()


@pytest.mark.parametrize("name", sorted(DRAWN))
def test_the_picture_shows_the_models_as_they_are(name: str) -> None:
    committed = (IMAGES / name).read_text(encoding="utf-8")
    assert committed == DRAWN[name], "run `python docs/images/examples.py`"


@pytest.mark.parametrize("path", sorted(IMAGES.glob("*.svg")), ids=lambda path: path.name)
def test_the_picture_is_well_formed(path: Path) -> None:
    assert ElementTree.parse(path).getroot().tag == "{http://www.w3.org/2000/svg}svg"
