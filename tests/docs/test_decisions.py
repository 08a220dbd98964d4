"""The index of decisions has every record, and both say which one is overruled by which."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[2] / "docs" / "decisions"
RECORDS = sorted(FOLDER.glob("[0-9]*.md"))
ROW = re.compile(r"^\| \[(\d+)\]\((\S+)\) \| (.+) \| (.*) \|$", re.MULTILINE)
MARK = re.compile(r"\A# .+\n\n\*(Overruled(?: in part)? by) ([^*]+)\*$", re.MULTILINE)


def title_of(record: Path) -> tuple[str, str]:
    found = re.match(r"# (\d+)\. (.+)\n", record.read_text(encoding="utf-8"))
    assert found is not None, record
    return found[1], found[2]


def status_of(record: Path) -> str:
    """As the index has it: overruled by which numbers; empty if it holds."""
    mark = MARK.match(record.read_text(encoding="utf-8"))
    if mark is None:
        return ""
    numbers = re.findall(r"\[(\d+)\]", mark[2])
    return f"{mark[1].lower()} {' and '.join(numbers)}"


def test_the_index_has_every_record_with_its_title_and_status() -> None:
    rows = ROW.findall((FOLDER / "README.md").read_text(encoding="utf-8"))
    assert rows == [
        (number, record.name, title, status_of(record))
        for record in RECORDS
        for number, title in [title_of(record)]
    ]


@pytest.mark.parametrize("record", RECORDS, ids=lambda record: record.stem)
def test_a_record_is_overruled_by_a_later_one_only(record: Path) -> None:
    number, _ = title_of(record)
    assert record.name.startswith(f"{int(number):04}-")
    assert all(int(other) > int(number) for other in re.findall(r"\d+", status_of(record)))
    assert ("verruled" in record.read_text(encoding="utf-8")) == bool(status_of(record))
