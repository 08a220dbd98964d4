"""What is made of the measurements: tables, files, runs put together, the page."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from benchmarks.page import page_with, put
from examples.overhead import __main__ as command
from examples.overhead import blocks, results, tables
from examples.overhead.__main__ import main
from examples.overhead.blocks import SERIES
from examples.overhead.machine import this_machine
from tests.examples.overhead_made_up import made_up


def test_ways_to_monitor_stand_below_each_other_and_the_papers_above_them() -> None:
    first, *_ = results.made_tables(made_up())["table3"]
    assert first.rows[-1] == (
        "both",
        "65,670 (16.94)",
        "327,816 (47.47)",
        "333,764 (54.77)",
        "298,117 (63.44)",
        "864,467 (28.91)",
    )
    ten, saturated = tables.table3(made_up().cells)
    assert (ten.title, saturated.title) == ("Zenoh, 10 ticks/s", "Zenoh, saturated")
    assert ten.header[:6] == ("", *SERIES)
    by_label = {row[0]: row[1:] for row in ten.rows}
    assert by_label["no monitor"][0].startswith("100 (")
    assert by_label["no monitor, again"][3] == ""
    assert by_label["no monitor, again"][4].startswith("101 · 1.01 (")
    assert by_label["both, passive"][0].startswith("104 · 1.04 (")
    websocket = by_label["both, in the middle (WebSocket)"]
    assert websocket[4].startswith("300 · 3.00 (")
    assert websocket[5:] == ("306 / 306", "6", "2", "0.10", "2.5")


def test_blocks_that_are_not_monitored_are_counted_below_the_table() -> None:
    made = made_up()
    deaf = [
        msgspec.structs.replace(block, deaf="heard nothing")
        if (block.configuration, block.rate_hz, block.round) == ("both", 10.0, 0)
        else block
        for block in made.blocks
    ]
    ten, saturated = tables.table3(blocks.cells(deaf))
    assert (ten.note, saturated.note) == ("Blocks not monitored: both: 1 of 2.", "")


def test_failures_are_shown_beside_the_figures() -> None:
    found = [cell for cell in results.summary(made_up())["cells"] if cell["experiment"] == "table3"]
    failures = {cell["configuration"]: cell["failures"] for cell in found}
    assert failures == {"none": 0, "control": 0, "both": 0, "both-websocket": 2}
    assert all(cell["found"]["count"] == 6 for cell in found)


def test_targets_say_whether_they_are_met() -> None:
    cells = made_up().cells
    assert [item.is_met for item in blocks.targets(cells)] == [True, True]
    assert "| Zenoh, 10 ticks/s | 1.04 (" in tables.as_markdown(tables.targets(cells))


def test_a_node_on_a_machine_of_half_the_speed_costs_the_same_times() -> None:
    def window(tapped: bool, number: int, micros: float) -> blocks.Block:
        who = "tap" if tapped else "none"
        values = {"processor": [micros], "idle": [0.0]}
        return blocks.Block("cost", "zenoh", 10.0, 0.0, who, number, values, {})

    windows = [
        window(tapped, number, speed * (150.0 if tapped else 100.0))
        for number, speed in enumerate((1.0, 2.0, 1.5))
        for tapped in (False, True)
    ]
    alone = window(True, 3, 1000.0)  # its round was not measured untapped
    *_, found, idle = blocks.cells([*windows, alone])
    assert found.ratio is not None
    assert (found.ratio.value, found.ratio.low, found.ratio.high) == pytest.approx((1.5, 1.5, 1.5))
    assert idle.ratio is None  # nothing is a multiple of nothing
    assert blocks.cells([alone]) == []


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
    cell = next(c for c in both.cells if (c.configuration, c.series) == ("both", "ROOT"))
    assert cell.found.count == 12
    assert cell.ratio is not None
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
        "asleep": {"machine": this_machine(is_awake=False)},
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
    marked = "".join(f"text\n<!-- begin {name} -->\nold\n<!-- end {name} -->\n" for name in names)
    page.write_text(f"# Page\n{marked}the end\n", encoding="utf-8")
    results.rewrite([page], made)
    first = page.read_text(encoding="utf-8")
    assert first.startswith("# Page\ntext\n")
    assert first.endswith("the end\n")
    assert "old" not in first
    assert "864,467" in first
    results.rewrite([page], made)
    assert page.read_text(encoding="utf-8") == first


def test_sections_go_to_the_pages_that_have_their_markers(tmp_path: Path) -> None:
    made = made_up()
    names = list(results.sections(made))
    marked = {name: f"<!-- begin {name} -->\nold\n<!-- end {name} -->\n" for name in names}
    first, second = tmp_path / "first.md", tmp_path / "second.md"
    first.write_text("".join(marked[name] for name in names[:2]), encoding="utf-8")
    second.write_text("".join(marked[name] for name in names[2:-1]), encoding="utf-8")
    with pytest.raises(ValueError, match=f"no <!-- begin {names[-1]} -->"):
        results.rewrite([first, second], made)
    assert "old" in first.read_text(encoding="utf-8")  # no page was changed
    second.write_text("".join(marked[name] for name in names[2:]), encoding="utf-8")
    results.rewrite([first, second], made)
    assert "old" not in first.read_text(encoding="utf-8") + second.read_text(encoding="utf-8")
    assert f"begin {names[0]}" not in second.read_text(encoding="utf-8")


def test_every_section_has_its_place_on_a_page() -> None:
    texts = {page: page.read_text(encoding="utf-8") for page in command.PAGES}
    for name, content in results.sections(made_up()).items():
        page = page_with(texts, name)
        texts[page] = put(texts[page], name, content)


def test_growth_has_a_table_and_a_note_on_its_knee() -> None:
    table = tables.growth(made_up().cells)
    assert table.rows[0][:3] == ("taps; Zenoh, 10 ticks/s", "0", "100")
    assert table.rows[1][:4] == ("", "1", "100", "120")
    assert table.note == "Knees: none."


def test_a_turn_that_could_not_be_measured_leaves_the_other_rounds() -> None:
    own = [
        block
        for block in made_up().blocks
        if (block.configuration, block.round) not in (("both", 0), ("none", 1))
    ]
    cells = [cell for cell in blocks.cells(own) if cell.experiment == "table3"]
    assert {cell.configuration for cell in cells} == {"none", "control", "both-websocket"}
    root = next(c for c in cells if (c.configuration, c.series) == ("both-websocket", "ROOT"))
    assert root.ratio is not None
    assert (root.found.count, root.ratio.value) == (6, 3.0)
