"""The page of all benchmarks: rows beside a peer's, tables between markers, failures said."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path
from typing import Literal

import pytest

from benchmarks.page import Row, command

ROOT = Path(__file__).parents[2]
SCRIPT = """
from benchmarks.page import Row, beside, publish
publish([
    beside("a tick", "µs", [[100.0], [120.0], [140.0]], "bare", [[100.0]] * 3, most=1.1),
    beside("speed", "events/s", [[1_234_567.0]], "peer", [[1_000_000.0]], least=1.0),
    Row("lost", 0, "", most=0.0),
    beside("a command", "s", [[0.25]], "click", [[0.1]], most=0.7, is_of_value=True),
])
"""


@pytest.fixture
def page(tmp_path: Path, monkeypatch):
    """``benchmarks.__main__`` over a folder with one module of our own."""
    module = importlib.import_module("benchmarks.__main__")
    folder = tmp_path / "benchmarks"
    folder.mkdir()
    for part in ("page", "sampling"):
        (folder / f"{part}.py").write_bytes((ROOT / f"benchmarks/{part}.py").read_bytes())
    (folder / "one.py").write_text(SCRIPT, encoding="utf-8")
    (tmp_path / "page.md").write_text(
        "# Page\n<!-- begin one -->\nold\n<!-- end one -->\nthe end\n", encoding="utf-8"
    )
    monkeypatch.setattr(module, "HERE", folder)
    return module


def test_figures_are_put_between_the_pages_markers(page, tmp_path: Path) -> None:
    file = tmp_path / "page.md"
    assert page.main(["--page", str(file)]) == 0
    text = file.read_text(encoding="utf-8")
    assert text.startswith("# Page\n<!-- begin one -->\n|")
    assert text.endswith("<!-- end one -->\nthe end\n")
    assert "old" not in text
    assert "| a tick | 120 µs | bare 100 µs | 1.19 (1.00–1.40) | ≤ 1.10 | **not reached** |" in text
    assert (
        "| speed | 1,234,567 events/s | peer 1,000,000 events/s | 1.23 | ≥ 1.00 | reached |" in text
    )
    assert "| lost | 0 |  |  | ≤ 0 | reached |" in text
    assert "| a command | 0.25 s | click 0.10 s | 2.50 | ≤ 0.70 s | reached |" in text


def test_figures_go_to_the_page_that_has_their_markers(page, tmp_path: Path) -> None:
    other = tmp_path / "other.md"
    other.write_text("# Other\n", encoding="utf-8")
    assert page.main(["--page", str(other), str(tmp_path / "page.md")]) == 0
    assert other.read_text(encoding="utf-8") == "# Other\n"
    assert "| a tick |" in (tmp_path / "page.md").read_text(encoding="utf-8")


def test_a_benchmark_that_fails_is_said_and_the_page_stays(page, tmp_path, capfd) -> None:
    (tmp_path / "benchmarks/one.py").write_text("raise SystemExit(3)", encoding="utf-8")
    file = tmp_path / "page.md"
    before = file.read_text(encoding="utf-8")
    assert page.main(["--page", str(file)]) == 1
    assert "error: one did not go to its end" in capfd.readouterr().err
    assert file.read_text(encoding="utf-8") == before


def test_a_page_without_the_markers_is_said(page, tmp_path: Path, capfd) -> None:
    file = tmp_path / "page.md"
    file.write_text("# Page\n", encoding="utf-8")
    assert page.main(["--page", str(file)]) == 1
    assert "one: the page has no <!-- begin one -->" in capfd.readouterr().err


def test_an_unknown_benchmark_is_exit_code_2(page, capfd) -> None:
    assert page.main(["two"]) == 2
    assert "no benchmark two; there are one" in capfd.readouterr().err


def test_every_benchmark_that_tells_figures_has_its_place_on_a_page() -> None:
    pages = importlib.import_module("benchmarks.__main__").PAGES
    text = "".join(page.read_text(encoding="utf-8") for page in pages)
    telling = [
        path.stem
        for path in (ROOT / "benchmarks").glob("[a-z]*.py")
        if "\nfrom benchmarks.page import" in path.read_text(encoding="utf-8")
    ]
    assert len(telling) >= 10
    assert [name for name in telling if f"<!-- begin {name} -->" not in text] == []


def a_benchmark(rate: int = 3, transport: Literal["zenoh", "ros2"] = "zenoh") -> list[Row]:
    return [Row(transport, rate, "messages/s")]


def test_arguments_of_what_measures_are_the_options_of_its_command(monkeypatch, capsys) -> None:
    monkeypatch.setattr(sys, "argv", ["benchmark", "--rate", "5", "--transport", "ros2"])
    command(a_benchmark)
    assert capsys.readouterr().out == "ros2: 5 messages/s\n"


def test_an_option_that_is_none_is_exit_code_2(monkeypatch, capsys) -> None:
    monkeypatch.setattr(sys, "argv", ["benchmark", "--transport", "carrier pigeon"])
    with pytest.raises(SystemExit, match="2"):
        command(a_benchmark)
    assert "invalid choice: 'carrier pigeon'" in capsys.readouterr().err
