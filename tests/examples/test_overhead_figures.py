"""The figures of the overhead comparison: statistics on known data, order, knees, tables, accounts."""

from __future__ import annotations

import functools
import itertools
import os
import random
import statistics
import time
from pathlib import Path

import msgspec
import pytest

from examples.overhead import accounts, growth_points, node_cost, results, sample, schedule, table3
from examples.overhead.__main__ import main
from examples.overhead.agreement import agreement, figures
from examples.overhead.load import LEVEL_S, phases
from examples.overhead.machine import this_machine
from examples.overhead.observers import CONFIGURATIONS, Heard, deaf, told
from examples.overhead.plant import read_system
from examples.overhead.tables import as_markdown, beside_the_paper, growth_tables, targets
from m2c.model.machine import InterfaceKind

DRAW = random.Random(4)


def normal_blocks(rounds: int, ticks: int, middle: float = 100.0, between: float = 0.0):
    """Blocks of normal samples; ``between`` is how far apart the blocks are."""
    return [
        [DRAW.gauss(shift, 10.0) for _ in range(ticks)]
        for shift in [DRAW.gauss(middle, between) for _ in range(rounds)]
    ]


# -- statistics -------------------------------------------------------------------------------------


def test_a_resampled_median_is_distributed_as_that_of_a_real_bootstrap_sample() -> None:
    ordered = sorted(DRAW.gauss(0, 1) for _ in range(41))
    draw = random.Random(5)
    quick = [sample.resampled_median(draw, ordered) for _ in range(4000)]
    slow = [statistics.median(draw.choices(ordered, k=len(ordered))) for _ in range(4000)]
    assert statistics.fmean(quick) == pytest.approx(statistics.fmean(slow), abs=0.02)
    assert statistics.stdev(quick) == pytest.approx(statistics.stdev(slow), rel=0.1)


@pytest.mark.parametrize("rounds", [6, 8])
def test_the_interval_has_the_true_median_in_nine_of_ten_cases(rounds: int) -> None:
    hits = 0
    for _ in range(40):
        found = sample.distribution(normal_blocks(rounds, 20, between=5.0)).p50
        hits += found.low <= 100.0 <= found.high
    assert hits >= 36


@pytest.mark.parametrize(
    ("rounds", "left_out"),
    # Student's t of 0.975 from a table (5, 7, 29 degrees of freedom), times the root of n / (n - 1)
    [(6, 2.571 * 1.0954), (8, 2.365 * 1.0690), (30, 2.045 * 1.0171)],
)
def test_the_fewer_rounds_the_further_out_an_interval_ends(rounds: int, left_out: float) -> None:
    assert sample.tail(rounds) == pytest.approx(statistics.NormalDist().cdf(-left_out), rel=0.03)


def test_an_interval_of_two_rounds_is_all_that_was_drawn() -> None:
    found = sample.distribution([[100.0] * 5, [110.0] * 5]).p50
    assert (found.low, found.high) == (100.0, 110.0)
    assert sample.tail(1) == pytest.approx(0.025)


def test_blocks_that_differ_make_the_interval_wider() -> None:
    alike = sample.distribution(normal_blocks(8, 40)).p50
    apart = sample.distribution(normal_blocks(8, 40, between=20.0)).p50
    assert apart.high - apart.low > 2 * (alike.high - alike.low)


def test_a_ratio_is_found_though_the_machine_becomes_three_times_slower() -> None:
    base, other = [], []
    for number in range(8):
        drift = 1 + number / 4
        base.append([drift * DRAW.gauss(100, 5) for _ in range(30)])
        other.append([1.5 * drift * DRAW.gauss(100, 5) for _ in range(30)])
    found = sample.ratio(other, base)
    assert found.low < 1.5 < found.high
    assert found.high - found.low < 0.2


def test_a_ratio_is_not_moved_by_one_bad_round() -> None:
    found = sample.middle_ratio(
        [108.0, 109.0, 110.0, 110.0, 110.0, 111.0, 112.0, 400.0], [100.0] * 8
    )
    assert 1.09 < found < 1.12


def test_a_ratio_of_few_rounds_is_nearer_the_truth_than_their_median() -> None:
    ours, medians = [], []
    for _ in range(300):
        pairs = [(DRAW.gauss(100, 10), DRAW.gauss(100, 10)) for _ in range(8)]
        ours.append(abs(sample.middle_ratio(*zip(*pairs, strict=True)) - 1))
        medians.append(abs(statistics.median(a / b for a, b in pairs) - 1))
    assert statistics.mean(ours) < statistics.mean(medians)


def test_the_same_samples_give_the_same_interval() -> None:
    blocks = normal_blocks(3, 10)
    assert sample.distribution(blocks) == sample.distribution(blocks)


def test_blocks_that_are_not_pairs_have_no_ratio() -> None:
    with pytest.raises(ValueError, match="3 blocks against 2"):
        sample.ratio(normal_blocks(3, 5), normal_blocks(2, 5))


def test_p99_worst_and_count_are_of_all_values() -> None:
    found = sample.distribution([[float(value) for value in range(100)], [1000.0] * 100])
    assert (found.p99, found.worst, found.count) == (1000.0, 1000.0, 200)
    assert sample.quantile([5.0, 1.0, 3.0], 0.5) == 3.0
    assert sample.quantile([], 0.5) == 0.0


# -- order ------------------------------------------------------------------------------------------


def test_each_round_has_everything_once_and_not_always_in_the_same_order() -> None:
    turns = list(schedule.rounds("abcd", 6, seed=1))
    orders = [[item for number, item in turns if number == wanted] for wanted in range(6)]
    assert all(sorted(order) == list("abcd") for order in orders)
    assert len({tuple(order) for order in orders}) > 1
    assert turns == list(schedule.rounds("abcd", 6, seed=1))


# -- monitors ---------------------------------------------------------------------------------------

BY_NAME = {item.name: item for item in CONFIGURATIONS}


def test_a_monitor_that_heard_too_little_does_not_count() -> None:
    both = BY_NAME["both"]
    assert "heard 3 of at least" in deaf(both, Heard(3, 0, 9), ticks=10)
    assert deaf(both, Heard(1000, 0, 9), ticks=10) == ""
    assert deaf(BY_NAME["none"], Heard(), ticks=10) == ""


def test_a_monitor_that_found_a_fault_where_there_is_none_does_not_count() -> None:
    assert "1 violations" in deaf(BY_NAME["models"], Heard(1000, 1, 4), ticks=10)


def test_a_monitor_that_found_nothing_to_conform_does_not_count() -> None:
    alone = BY_NAME["models-in-process"]
    assert deaf(alone, Heard(1000, 0, 0), ticks=10) == "found nothing to be as it should"
    doubts = ("P1: messages on /level were missed",)
    heard = Heard(1000, 0, 0, doubts=doubts)
    assert deaf(alone, heard, ticks=10).endswith(f"should: {doubts[0]}")


def test_what_a_monitor_could_not_judge_is_kept_with_its_reason() -> None:
    machine = {"violations": 0, "lag_ms": None}
    said = [
        {
            "event": "summary",
            "machines": [
                {"machine": "P1", "verdict": "inconclusive", "last": "a loss", **machine},
                {"machine": "P2", "verdict": "conforming", "last": "", **machine},
            ],
            "counts": {"heard": 7},
            "problems": [],
        }
    ]
    assert told(said) == Heard(7, 0, 1, None, doubts=("P1: a loss",))


# -- growth -----------------------------------------------------------------------------------------


def run(
    x: float, watchers: int, micros: float, number: int = 0, **fields: float
) -> growth_points.Run:
    made = growth_points.Run(
        "taps", "zenoh", 10.0, x, number, watchers, [micros] * 20, 0, (), 10.0, 0.1, 0.3
    )
    return msgspec.structs.replace(made, **fields)


def test_the_knee_is_where_the_whole_interval_is_dear() -> None:
    runs = [
        run(x, int(x), micros, number)
        for number in range(3)
        for x, micros in ((0, 100.0), (1, 105.0), (2, 140.0), (4, 300.0))
    ]
    runs = [msgspec.structs.replace(item, busy=0.95) if item.x == 2 else item for item in runs]
    (line,) = growth_points.series(growth_points.points(runs))
    assert [point.ratio.value for point in line] == [1.0, 1.05, 1.4, 3.0]
    found = growth_points.knee(line)
    assert found.x == 2
    assert "1.40 times; the machine is full" in found.why


def test_a_watcher_that_is_late_is_a_knee_too() -> None:
    runs = [run(0, 0, 100.0), run(1, 1, 100.0, lag_ms=20.0, lag_p99_ms=150.0, processor=0.99)]
    found = growth_points.knee(growth_points.points(runs))
    assert found.x == 1
    assert "150 ms behind; the watchers use 1.0 cores" in found.why


def test_where_nothing_is_dear_there_is_no_knee() -> None:
    found = growth_points.knee(growth_points.points([run(0, 0, 100.0), run(1, 1, 101.0)]))
    assert found.x is None


def test_saturation_comes_after_all_rates() -> None:
    runs = [
        msgspec.structs.replace(run(x, watchers, 100.0), experiment="rate", rate_hz=x)
        for x in (0.0, 100.0, 1.0)
        for watchers in (0, 1)
    ]
    assert [point.x for point in growth_points.points(runs)] == [1.0, 100.0, 0.0]


# -- the plan ---------------------------------------------------------------------------------------


def test_what_is_far_from_any_target_has_its_turn_in_the_first_rounds_only() -> None:
    plan = table3.Plan(rounds=3, ticks={0.0: 1}, few=1)
    turns = [
        {item.name for item in CONFIGURATIONS if plan.has_turn(item, number)} for number in range(3)
    ]
    assert turns == [{item.name for item in CONFIGURATIONS}, set(table3.CORE), set(table3.CORE)]


def test_ratios_are_of_the_rounds_in_which_there_was_a_turn() -> None:
    found = made_up()
    blocks = [b for b in found.table3.blocks if b.round == 0 or b.configuration in table3.CORE]
    measured = msgspec.structs.replace(found.table3, blocks=tuple(blocks))
    counts = {
        cell.configuration: (cell.micros.count, round(cell.ratio.value, 2))
        for cell in table3.cells(measured)
        if cell.series == table3.ROOT and cell.rate_hz == 10
    }
    assert counts == {
        "none": (6, 1.0),
        "control": (6, 1.01),
        "both": (6, 1.04),
        "both-websocket": (3, 3.0),
    }


def test_orders_begin_anywhere_between_two_levels_evenly() -> None:
    for taken in (6, 8, 30):
        places = sorted(itertools.islice(phases(), taken))
        gaps = [after - before for before, after in itertools.pairwise([0.0, *places, 1.0])]
        assert max(gaps) < 2.7 / taken, taken


def test_the_battery_tells_its_level_as_often_as_the_load_takes_it() -> None:
    (battery,) = (node for node in read_system().nodes if node.name == "BatteryComponent")
    (measure,) = (item for item in battery.interfaces if item.kind is InterfaceKind.TIMER)
    assert measure.rate_hz == 1 / LEVEL_S


# -- accounts ---------------------------------------------------------------------------------------


def test_the_account_of_a_process_is_its_processor_time() -> None:
    before, own = accounts.processor_s(os.getpid()), time.process_time()
    assert abs(before - own) < 0.1
    sum(range(300_000))
    assert accounts.processor_s(os.getpid()) > before


def test_a_process_that_is_not_there_has_no_account() -> None:
    with pytest.raises(OSError, match="process 999999999"):
        accounts.processor_s(999_999_999)


def test_the_bytes_of_an_interface_are_counted() -> None:
    sent, packets = accounts.bytes_sent(os.getpid(), "lo")
    assert sent >= packets >= 0
    with pytest.raises(KeyError):
        accounts.bytes_sent(os.getpid(), "no_such_interface")


# -- results ----------------------------------------------------------------------------------------


@functools.cache
def made_up() -> results.Results:
    """Two rounds of no monitor, its control, and two ways to monitor."""
    cost = {"none": 100.0, "control": 101.0, "both": 104.0, "both-websocket": 300.0}
    blocks = tuple(
        table3.Block(
            "zenoh",
            rate_hz,
            name,
            number,
            {series: [micros, micros * 1.02, micros * 0.98] for series in table3.SERIES},
            {series: int(name == "both-websocket") for series in table3.SERIES},
            (),
            0.1,
            0.5,
            rate_hz or 200.0,
        )
        for rate_hz in (10.0, 0.0)
        for number in range(2)
        for name, micros in cost.items()
    )
    attachments = tuple(
        table3.Attachment("zenoh", name, number, Heard(100, 0, 5, 2.5), "")
        for number in range(2)
        for name in cost
    )
    windows = tuple(
        node_cost.Window("zenoh", 10.0, tapped, number, 500.0, 300.0, 2.0, 900.0, 100.0, 90.0, 0)
        for tapped in (False, True)
        for number in range(2)
    )
    return results.Results(
        this_machine(is_awake=True),
        "python -m examples.overhead --quick",
        "2026-01-01 12:00",
        1.0,
        table3.Measured(blocks, attachments),
        (run(0, 0, 100.0), run(1, 1, 120.0)),
        windows,
    )


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
