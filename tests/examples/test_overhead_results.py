"""What is made of the measurements: tables, agreement, files, runs put together, the page, figures."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from examples.overhead import node_cost, results, table3
from examples.overhead.__main__ import main
from examples.overhead.agreement import agreement, figures
from examples.overhead.machine import this_machine
from examples.overhead.tables import as_markdown, beside_the_paper, growth_tables, targets
from tests.examples.overhead_made_up import made_up


def test_the_papers_columns_stand_beside_ours() -> None:
    cells = made_up().cells
    ten, saturated = beside_the_paper(cells)
    assert (ten.title, saturated.title) == (
        "Table III on Zenoh, 10 ticks/s",
        "Table III on Zenoh, saturated",
    )
    both = next(row for row in ten.rows if row[:2] == ("ROOT", "4 both"))
    assert both[2] == "864,467 (28.91)"
    assert both[3].startswith("104 · 1.04 (")
    assert both[4].startswith("300 · 3.00 (")
    assert "no monitor again (what chance does): ROOT 1.01" in ten.note


def test_failures_are_shown_beside_the_figures() -> None:
    found = results.summary(made_up())
    failures = {cell["configuration"]: cell["failures"] for cell in found["table3"]}
    assert failures == {"none": 0, "control": 0, "both": 0, "both-websocket": 2}
    assert all(cell["micros"]["count"] == 6 for cell in found["table3"])


def test_targets_say_whether_they_are_met() -> None:
    cells = made_up().cells
    assert [item.is_met for item in table3.targets(cells)] == [True, True]
    assert "| Zenoh, 10 ticks/s | 1.04 (" in as_markdown(targets(cells))


def test_runs_whose_intervals_overlap_agree_and_the_others_are_named() -> None:
    made = made_up()
    same = agreement(made, made)
    assert not same.rows
    assert same.note == f"{len(figures(made))} of {len(figures(made))} intervals overlap."
    slower = [
        msgspec.structs.replace(
            block, micros={s: [2 * m for m in v] for s, v in block.micros.items()}
        )
        if (block.configuration, block.rate_hz) == ("both", 10.0)
        else block
        for block in made.table3.blocks
    ]
    other = msgspec.structs.replace(made, table3=table3.Measured(tuple(slower), ()))
    apart = agreement(made, other)
    assert [row[0] for row in apart.rows] == [
        f"Zenoh, 10 ticks/s, {series}, both" for series in table3.SERIES
    ]
    assert [row[2].partition(" ")[0] for row in apart.rows] == ["2.08"] * len(table3.SERIES)


def test_a_node_on_a_machine_of_half_the_speed_costs_the_same_times() -> None:
    def window(tapped: bool, number: int, micros: float) -> node_cost.Window:
        return node_cost.Window("zenoh", 10.0, tapped, number, micros, 300.0, 2.0, 9.0, 1.0, 9.0, 0)

    windows = [
        window(tapped, number, speed * (150.0 if tapped else 100.0))
        for number, speed in enumerate((1.0, 2.0, 1.5))
        for tapped in (False, True)
    ]
    alone = window(True, 3, 1000.0)  # its round was not measured untapped
    (found,) = node_cost.dearer([*windows, alone]).values()
    assert (found.value, found.low, found.high) == pytest.approx((1.5, 1.5, 1.5))
    assert node_cost.dearer([alone]) == {}


def test_results_are_the_same_after_they_were_saved(tmp_path: Path) -> None:
    made = made_up()
    results.save(made, tmp_path)
    again = results.read(tmp_path / results.FILE)
    assert again == made
    assert results.sections(again) == results.sections(made)
    lines = (tmp_path / "table3.csv").read_text(encoding="utf-8").splitlines()
    assert lines[0].startswith("transport,rate_hz,configuration,series,micros_p50_value")
    assert len(lines) == 1 + 2 * 4 * len(table3.SERIES)
    assert len((tmp_path / "growth.csv").read_text(encoding="utf-8").splitlines()) == 3
    assert len((tmp_path / "cost.csv").read_text(encoding="utf-8").splitlines()) == 3


def test_runs_together_are_one_of_all_their_rounds() -> None:
    made = made_up()
    faster = [
        msgspec.structs.replace(b, micros={s: [m / 2 for m in v] for s, v in b.micros.items()})
        for b in made.table3.blocks
    ]
    other = msgspec.structs.replace(
        made,
        began="2026-01-02 12:00",
        table3=table3.Measured(tuple(faster), made.table3.attachments),
        problems=("the bus was late",),
    )
    both = results.joined([made, other])
    assert {block.round for block in both.table3.blocks} == {0, 1, 2, 3}
    assert {item.round for item in both.table3.attachments} == {0, 1, 2, 3}
    assert {window.round for window in both.windows} == {0, 1, 2, 3}
    assert [item.round for item in both.growth] == [0, 0, 1, 1]
    cell = next(c for c in both.cells if (c.configuration, c.series) == ("both", "ROOT"))
    assert cell.micros.count == 12
    assert cell.ratio.value == pytest.approx(1.04)  # each round beside its own, however fast it was
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
    results.rewrite(page, made)
    first = page.read_text(encoding="utf-8")
    assert first.startswith("# Page\ntext\n")
    assert first.endswith("the end\n")
    assert "old" not in first
    assert "864,467" in first
    results.rewrite(page, made)
    assert page.read_text(encoding="utf-8") == first


def test_a_page_without_a_marker_is_not_rewritten() -> None:
    with pytest.raises(ValueError, match="begin growth"):
        results.replaced("# Page", "growth", "text")


def test_every_section_has_its_place_on_the_page() -> None:
    page = Path(results.__file__).parents[2] / "docs/overhead.md"
    text = page.read_text(encoding="utf-8")
    for name, content in results.sections(made_up()).items():
        text = results.replaced(text, name, content)


def test_figures_are_drawn_twice_each_and_the_same_again(tmp_path: Path) -> None:
    from examples.overhead.figures import draw

    drawn = draw(made_up(), tmp_path)
    assert sorted(path.name for path in drawn) == [
        "overhead-table3-zenoh.png",
        "overhead-table3-zenoh.svg",
        "overhead-taps.png",
        "overhead-taps.svg",
    ]
    first = (tmp_path / "overhead-taps.svg").read_bytes()
    draw(made_up(), tmp_path)
    assert (tmp_path / "overhead-taps.svg").read_bytes() == first


def test_growth_has_a_table_and_a_note_on_its_knee() -> None:
    (table,) = growth_tables(made_up().points)
    assert table.rows[1][:3] == ("1", "100", "120")
    assert table.note.startswith("Knee: no knee")


def test_a_turn_that_could_not_be_measured_leaves_the_other_rounds() -> None:
    made = made_up()
    blocks = tuple(
        block
        for block in made.table3.blocks
        if (block.configuration, block.round) not in (("both", 0), ("none", 1))
    )
    cells = table3.cells(table3.Measured(blocks, made.table3.attachments))
    assert {cell.configuration for cell in cells} == {"none", "control", "both-websocket"}
    root = next(c for c in cells if (c.configuration, c.series) == ("both-websocket", "ROOT"))
    assert (root.micros.count, root.ratio.value) == (6, 3.0)
