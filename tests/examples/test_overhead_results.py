"""What is made of the measurements: tables, files, runs put together, the page."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from benchmarks.page import put
from examples.overhead import __main__ as command
from examples.overhead import blocks, results, tables
from examples.overhead.__main__ import main
from examples.overhead.blocks import SERIES
from examples.overhead.machine import described
from tests.examples.overhead_made_up import made_up

pytestmark = pytest.mark.slow


def cells_of(table: str) -> list[list[str]]:
    """The cells of a table in Markdown, row by row."""
    return [[cell.strip() for cell in line.split("|")[1:-1]] for line in table.splitlines()]


def test_ways_to_monitor_stand_below_each_other_and_the_papers_above_them() -> None:
    text = results.sections(made_up())["table3"]
    paper, *ours = (cells_of(table) for table in text.split("\n\n"))
    assert paper[-1] == [
        "both",
        "65,670 (16.94)",
        "327,816 (47.47)",
        "333,764 (54.77)",
        "298,117 (63.44)",
        "864,467 (28.91)",
    ]
    ten, saturated = ours
    assert (ten[0][0], saturated[0][0]) == ("Zenoh, 10 ticks/s", "Zenoh, saturated")
    assert tuple(ten[0][1:6]) == SERIES
    by_label = {row[0]: row[1:] for row in ten}
    assert by_label["no monitor"][0].startswith("100 (")
    assert by_label["no monitor, again"][3] == ""
    assert by_label["no monitor, again"][4].startswith("101 · 1.01 (")
    assert by_label["both, passive"][0].startswith("104 · 1.04 (")
    websocket = by_label["both, in the middle (WebSocket)"]
    assert websocket[4].startswith("300 · 3.00")
    # failed ticks are among the figures, and counted beside them
    assert websocket[5:] == ["306 / 306", "6", "2", "0.10", "2.5"]


def test_blocks_that_are_not_monitored_are_counted_below_the_table() -> None:
    deaf = [
        msgspec.structs.replace(block, deaf="received nothing")
        if (block.configuration, block.rate_hz, block.round) == ("both", 10.0, 0)
        else block
        for block in made_up().blocks
    ]
    ten, saturated = tables.table3(blocks.cells(deaf))
    assert ten.endswith("\n\nBlocks not monitored: both: 1 of 2 (received nothing).")
    assert "not monitored" not in saturated


def test_targets_say_whether_they_are_met() -> None:
    cells = blocks.cells(made_up().blocks)
    first, saturated = cells_of(tables.targets(cells))[2:]
    assert first[0] == "Zenoh, 10 ticks/s"
    assert first[1].startswith("1.04")
    assert (first[3], saturated[3]) == ("yes", "yes")


def test_results_are_the_same_after_they_were_saved(tmp_path: Path) -> None:
    made = made_up()
    results.save(made, tmp_path)
    again = results.read(tmp_path / results.FILE)
    assert again == made
    assert results.sections(again) == results.sections(made)
    assert "864,467" in (tmp_path / "overhead.md").read_text(encoding="utf-8")


def test_runs_together_are_one_of_all_their_rounds() -> None:
    made = made_up()
    faster = [
        msgspec.structs.replace(b, values={s: [m / 2 for m in v] for s, v in b.values.items()})
        for b in made.blocks
    ]
    other = msgspec.structs.replace(
        made,
        began="2026-01-02 12:00",
        blocks=tuple(faster),
        problems=("the bus was late",),
    )
    both = results.joined([made, other])
    assert {block.round for block in both.blocks} == {0, 1, 2, 3}
    cell = next(
        c for c in blocks.cells(both.blocks) if (c.configuration, c.series) == ("both", "ROOT")
    )
    assert cell.found.count == 12
    # each round beside its own, however fast it was
    assert cell.ratio.value == pytest.approx(1.04)
    assert (both.began, both.problems) == ("2026-01-01 12:00, 2026-01-02 12:00", other.problems)
    assert (both.minutes, both.command.count("--quick")) == (2.0, 2)


def test_one_run_together_is_itself() -> None:
    assert results.joined([made_up()]) == made_up()


def test_runs_that_are_not_rounds_of_one_are_not_put_together(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made = made_up()
    changes = {
        "asleep": {"machine": described(is_awake=False)},
        "later": {"began": "2026-01-02 12:00"},
    }
    results.save(made, tmp_path / "first")
    for name, change in changes.items():
        results.save(msgspec.structs.replace(made, **change), tmp_path / name)

    def together(*names: str) -> int:
        files = [str(tmp_path / name / results.FILE) for name in names]
        return main([word for file in files for word in ("--from", file)])

    assert together("first", "asleep") == 2
    assert "is of another machine" in capsys.readouterr().err
    assert together("first", "later", "first") == 2
    assert "the run of 2026-01-01 12:00 UTC is there twice" in capsys.readouterr().err
    assert together("first", "later") == 0
    assert "ROOT" in capsys.readouterr().out


def test_a_page_keeps_what_is_not_between_its_markers(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    made = made_up()
    names = results.sections(made)
    page.write_text("# Page\n<!-- begin machine -->\n<!-- end machine -->\n", encoding="utf-8")
    with pytest.raises(ValueError, match="no <!-- begin targets -->"):
        results.rewrite(page, made)
    assert "2026" not in page.read_text(encoding="utf-8")  # it was not changed
    marked = "".join(f"text\n<!-- begin {name} -->\nold\n<!-- end {name} -->\n" for name in names)
    page.write_text(f"# Page\n{marked}the end\n", encoding="utf-8")
    results.rewrite(page, made)
    first = page.read_text(encoding="utf-8")
    assert first.startswith("# Page\ntext\n")
    assert first.endswith("the end\n")
    assert "old" not in first
    assert "864,467" in first
    results.rewrite(page, made)
    assert page.read_text(encoding="utf-8") == first


def test_every_section_has_its_place_on_the_page() -> None:
    text = command.PAGE.read_text(encoding="utf-8")
    for name, content in results.sections(made_up()).items():
        put(text, name, content)


def test_a_turn_that_could_not_be_measured_leaves_the_other_rounds() -> None:
    own = [
        block
        for block in made_up().blocks
        if (block.configuration, block.round) not in (("both", 0), ("none", 1))
    ]
    cells = blocks.cells(own)
    assert {cell.configuration for cell in cells} == {"none", "control", "both-websocket"}
    root = next(c for c in cells if (c.configuration, c.series) == ("both-websocket", "ROOT"))
    assert (root.found.count, root.ratio.value) == (6, 3.0)
