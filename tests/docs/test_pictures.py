"""The committed pictures are what their script draws from today's models."""

from __future__ import annotations

import runpy
import tomllib
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

IMAGES = Path(__file__).parents[2] / "docs" / "images"
PROJECT: dict[str, Any] = tomllib.loads((IMAGES.parents[1] / "pyproject.toml").read_text())[
    "project"
]
DRAWN: dict[str, str] = runpy.run_path(str(IMAGES / "examples.py"))["pictures"]()


@pytest.mark.parametrize("name", sorted(DRAWN))
def test_the_picture_shows_the_models_as_they_are(name: str) -> None:
    committed = (IMAGES / name).read_text(encoding="utf-8")
    assert committed == DRAWN[name], "run `python docs/images/examples.py`"


@pytest.mark.parametrize("path", sorted(IMAGES.glob("*.svg")), ids=lambda path: path.name)
def test_the_picture_is_well_formed(path: Path) -> None:
    assert ElementTree.parse(path).getroot().tag == "{http://www.w3.org/2000/svg}svg"


def test_the_picture_of_the_report_is_of_the_page_as_it_is(tmp_path: Path) -> None:
    script = runpy.run_path(str(IMAGES / "report.py"))
    digest = script["write_page"](tmp_path / "report.html")
    assert script["SEEN_OF"].read_text() == f"{digest}\n", "run `python docs/images/report.py`"


def test_the_overview_names_every_transport() -> None:
    text = (IMAGES / "overview.svg").read_text(encoding="utf-8")
    assert [name for name in PROJECT["entry-points"]["m2c.transports"] if name not in text] == []
