"""A recording has several times: it is judged by the one that evidence speaks for, which is said, or by the chosen."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path

import pytest

from moon.monitor.subject import Subject, read_subject
from moon.offline.engine import check_recording
from moon.offline.view import View, instant
from moon.oracle.bounds import Bounds
from moon.recording.reader import open_recording
from moon.report.page import write_report
from moon.sources.time_choice import TimeChoice
from tests.offline.logs import (
    FOREIGN,
    LEVEL,
    NS,
    PORTS,
    T0,
    Form,
    Line,
    Stored,
    check,
    foreign_mcap,
    json_lines,
    ours,
    sqlite_bag,
    stored,
    write_mcap,
)

PROPERTIES = """\
  - {id: A, pattern: absence, of: level >= 9}
  - {id: R, pattern: recurrence, of: lv, within: 1500 ms}
"""
RESPONSE = "  - {id: R, pattern: response, request: go, response: alarm, within: 500 ms}\n"
FOUND = {"A": "violated", "R": "conforming"}
SIM_NS = 10 * NS
HOUR = 3600


def levels(published: float | None = None, count: int = 8) -> list[Line]:
    """A level that is 9 once, published so much after it was recorded (s)."""
    return [
        Line(n, 9 if n == 3 else 1, published_s=None if published is None else n + published)
        for n in range(count)
    ]


def on_simulated_time(log: bool, publish: bool) -> list[Stored]:
    return [
        Stored(
            item.topic,
            item.log_ns - (T0 - SIM_NS) * log,
            item.publish_ns - (T0 - SIM_NS) * publish,
            item.data,
        )
        for item in stored(levels())
    ]


@pytest.mark.parametrize(("log", "publish"), [(True, False), (False, True), (True, True)])
def test_simulated_time_on_one_side_or_both_loses_nothing(tmp_path: Path, log: bool, publish: bool):
    run = write_mcap(tmp_path / "run.mcap", on_simulated_time(log, publish))
    said = check(tmp_path, run, PROPERTIES)
    assert (said.code, said.verdicts) == (1, FOUND), said.out
    assert said.time.startswith("log_time")
    assert ("/level is stamped" in said.time) == (log != publish)
    assert f"\ntime: {said.time}\n" in said.out


@pytest.mark.parametrize(
    ("ahead_s", "why"),
    [
        (-HOUR, "/level is stamped 3,600.0 s before it was recorded"),
        (-0.5, "/level is stamped 0.5 s before it was recorded"),
        (0.3, "/level is stamped 0.3 s after it was recorded"),
        (HOUR, "/level is stamped 3,600.0 s after it was recorded"),
    ],
)
def test_a_publisher_whose_clock_differs_is_heard_when_it_was_recorded(
    tmp_path: Path, ahead_s: float, why: str
):
    lines = levels(ahead_s) + [Line(n + 0.1, 1, "/go") for n in range(8)]
    lines.sort(key=lambda line: line.at_s)
    said = check(tmp_path, foreign_mcap(tmp_path, lines), PROPERTIES)
    assert (said.code, said.verdicts) == (1, FOUND), said.out
    assert said.time == f"log_time, when each entry was recorded: {why}"


def test_where_stamps_are_given_up_the_order_of_channels_is_not_known(tmp_path: Path):
    for ahead_s, options in ((HOUR, ()), (-0.001, ("--time", "log")), (-0.001, ())):
        said = check(tmp_path, foreign_mcap(tmp_path, levels(ahead_s)), PROPERTIES, *options)
        is_by_reception = said.time.startswith("log_time")
        assert is_by_reception == (ahead_s == HOUR or bool(options))
        assert any("their order against other channels" in it for it in said.limits) == (
            is_by_reception
        ), said.out


@pytest.mark.parametrize(
    ("behind", "why"),
    [
        (lambda at_s: 0.9 * (at_s > 6), "for a while stamped 0.9 s before it was recorded"),
        (lambda at_s: 7.0 * (6 < at_s < 11), "for a while stamped 7.0 s before it was recorded"),
        (lambda at_s: 0.05 * at_s, "for a while stamped 0.2 s before it was recorded"),
    ],
    ids=["set back", "set back and mended", "too slow"],
)
def test_a_publisher_whose_clock_is_behind_for_a_while_is_heard_when_it_was_recorded(
    tmp_path: Path, behind: Callable[[float], float], why: str
):
    lines = [Line(n * 0.5, n % 4, published_s=n * 0.5 - 0.001) for n in range(40)]
    for n in range(9):
        at_s = 2.2 * n + 0.4
        lines.append(Line(at_s, 1, "/go", at_s - 0.001))
        lines.append(Line(at_s + 0.2, 1, "/alarm", at_s + 0.199 - behind(at_s)))
    lines.sort(key=lambda line: line.at_s)
    properties = (
        RESPONSE + "  - {id: P, pattern: precedence, cause: go, effect: alarm, within: 500 ms}\n"
    )
    run = foreign_mcap(tmp_path, lines)
    said = check(tmp_path, run, properties)
    assert said.verdicts == {"R": "conforming", "P": "conforming"}, said.out
    assert said.time == f"log_time, when each entry was recorded: /alarm is {why}"


@pytest.mark.parametrize("count", [1, 2])
@pytest.mark.parametrize("behind_s", [0.3, 0.9, 5.0])
def test_what_came_last_and_is_late_may_be_of_a_clock_that_was_set(
    tmp_path: Path, behind_s: float, count: int
):
    """One or two messages do not show whether a link kept them or their clock was set back."""
    lines = [Line(n * 0.5, n % 4, published_s=n * 0.5 - 0.001) for n in range(40)]
    for n in range(9):
        at_s = 2.2 * n + 0.4
        lines.append(Line(at_s, 1, "/go", at_s - 0.001))
        lines.append(Line(at_s + 0.2, 1, "/alarm", at_s + 0.199))
    for n in range(count):
        lines.append(Line(20.0, 1, "/go", 19.999))
        lines.append(Line(20.2 + 0.1 * n, 1, "/alarm", 20.199 + 0.1 * n - behind_s))
    lines.sort(key=lambda line: line.at_s)
    properties = (
        RESPONSE + "  - {id: P, pattern: precedence, cause: go, effect: alarm, within: 500 ms}\n"
    )
    said = check(tmp_path, foreign_mcap(tmp_path, lines), properties)
    assert "violated" not in said.verdicts.values(), said.out
    assert said.time.startswith("publish_time")


@pytest.mark.parametrize("unset_s", [-T0 / NS, -HOUR])
def test_stamps_that_nobody_set_now_and_then_tell_no_order(tmp_path: Path, unset_s: float):
    """A zero is not from before the recording: what a publisher has kept comes first."""
    lines = [Line(n * 0.5 + 0.003, n % 4, published_s=n * 0.5) for n in range(10)]
    lines[5] = Line(lines[5].at_s, lines[5].data, published_s=unset_s)
    said = check(tmp_path, foreign_mcap(tmp_path, lines), PROPERTIES)
    assert said.verdicts == {"A": "conforming", "R": "conforming"}, said.out
    why = "/level is now and then not stamped, or as before the recording"
    assert said.time == f"log_time, when each entry was recorded: {why}"


def test_hosts_set_back_together_show_it_in_the_order_of_their_stamps(tmp_path: Path):
    """Nobody's stamps are in time then: the recorder has a clock of its own."""
    lines = [Line(n * 0.25, n, published_s=n * 0.25 - 0.6 * (n > 20)) for n in range(40)]
    said = check(
        tmp_path,
        foreign_mcap(tmp_path, lines),
        "  - {id: F, pattern: absence, of: {falls: level > 20}}\n",
    )
    assert said.verdicts == {"F": "conforming"}, said.out
    assert said.time.endswith("/level is for a while stamped 0.6 s before it was recorded")


@pytest.mark.parametrize("catches_up", [0.0, 0.3], ids=["at once", "bit by bit"])
def test_what_a_link_delayed_keeps_its_stamps(tmp_path: Path, catches_up: float):
    """A link of one publisher stood still: what it kept came later, the rest in time."""
    lines = [Line(n * 0.25, 1, published_s=n * 0.25 - 0.001) for n in range(40)]
    for n in range(20):
        at_s = n * 0.5 + 0.4
        came_s = max(at_s, 6.0 + (at_s - 3.0) * catches_up) if 3 < at_s < 7 else at_s
        lines.append(Line(came_s + 0.002, 1, "/go", at_s))
    lines.sort(key=lambda line: line.at_s)
    said = check(
        tmp_path,
        foreign_mcap(tmp_path, lines),
        "  - {id: R, pattern: recurrence, of: go, within: 600 ms}\n",
    )
    assert said.verdicts == {"R": "conforming"}, said.out
    assert said.time.startswith("publish_time")


def test_stamps_that_agree_tell_the_order(tmp_path: Path):
    lines = [
        Line(0, 0, "/alarm", -0.001),
        Line(1.0, 1, "/alarm", 0.98),
        Line(1.001, 1, "/go", 0.97),  # published before, recorded after
        Line(3.0, 1, published_s=2.99),
    ]
    run = foreign_mcap(tmp_path, lines)
    said = check(tmp_path, run, RESPONSE)
    assert (said.code, said.verdicts) == (0, {"R": "conforming"}), said.out
    assert said.time.startswith("publish_time")
    said = check(tmp_path, run, RESPONSE, "--time", "log")
    assert (said.code, said.verdicts) == (0, {"R": "inconclusive"}), said.out
    assert said.time == "log_time, when each entry was recorded"


@pytest.mark.parametrize("ahead_s", [-HOUR, 0.3, HOUR])
def test_a_clock_that_matters_to_nobody_changes_nothing(tmp_path: Path, ahead_s: float):
    lines = [Line(n, 9 if n == 3 else 1, published_s=n - 0.01) for n in range(8)]
    lines += [Line(n + 0.1, 1, "/camera", n + 0.1 + ahead_s) for n in range(8)]
    lines.sort(key=lambda line: line.at_s)
    said = check(tmp_path, foreign_mcap(tmp_path, lines), PROPERTIES, "--strict")
    assert (said.code, said.verdicts) == (1, FOUND), said.out
    assert said.time.startswith("publish_time")


def test_what_was_latched_before_the_recording_counts_from_its_beginning(tmp_path: Path):
    lines = [
        Line(0, 5, "/go", -HOUR),
        *(Line(0.01 + n * 0.5, n == 4, published_s=n * 0.5) for n in range(8)),
    ]
    said = check(
        tmp_path,
        foreign_mcap(tmp_path, lines),
        "  - {id: G, pattern: existence, of: go, within: 100 ms}\n"
        "  - {id: R, pattern: recurrence, of: lv, within: 600 ms}\n",
    )
    assert said.verdicts == {"G": "conforming", "R": "conforming"}, said.out
    assert said.time.startswith("publish_time")


def test_a_recorder_that_stood_still_makes_no_silence(tmp_path: Path):
    lines = [Line(max(t, 4.0) if 1 < t < 4 else t, 1, published_s=t) for t in range(9)]
    run = foreign_mcap(tmp_path, [Line(i.at_s + 0.01, 1, published_s=i.published_s) for i in lines])
    said = check(tmp_path, run, PROPERTIES)
    assert said.verdicts == {"A": "conforming", "R": "conforming"}, said.out
    assert check(tmp_path, run, PROPERTIES, "--time", "log").verdicts["R"] == "violated"


HEADER = (
    "std_msgs/Header header\nint32 data\n"
    + "=" * 80
    + (
        "\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n"
        + "=" * 80
        + "\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
    )
)


def stamped(log_s: float, stamp_s: float, data: int) -> Stored:
    sec, nanosec = divmod(round(stamp_s * NS), NS)
    body = b"\0\1\0\0" + struct.pack("<iIIc3xi", sec, nanosec, 1, b"\0", data)
    at = T0 + round(log_s * NS)
    return Stored(LEVEL, at, at, body, "demo/msg/Stamped", HEADER)


def clock(log_s: float, time_s: float, topic: str = "/clock") -> Stored:
    sec, nanosec = divmod(round(time_s * NS), NS)
    definition = (
        "builtin_interfaces/Time clock\n"
        + "=" * 80
        + ("\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n")
    )
    at = T0 + round(log_s * NS)
    body = b"\0\1\0\0" + struct.pack("<iI", sec, nanosec)
    return Stored(topic, at, at, body, "rosgraph_msgs/msg/Clock", definition)


@pytest.mark.parametrize("field", ["header", "header.stamp"])
def test_the_time_of_headers_can_be_chosen(tmp_path: Path, field: str):
    """Measured every second, and recorded in bursts."""
    run = write_mcap(
        tmp_path / "run.mcap",
        [stamped(4 * (n // 4) + n * 0.001, 100 + n, 9 if n == 3 else 1) for n in range(8)],
    )
    assert check(tmp_path, run, PROPERTIES).verdicts["R"] == "violated"
    said = check(tmp_path, run, PROPERTIES, "--time", f"header:{field}")
    assert (said.code, said.verdicts) == (1, FOUND), said.out
    assert "00:01:43" in said.out
    assert said.time.startswith(f"{field} of messages")


NINE = "  - {id: P, pattern: precedence, cause: level >= 9, effect: alarm}\n"


@pytest.mark.parametrize(("before_s", "verdict"), [(0.1, "inconclusive"), (0.3, "violated")])
def test_by_headers_the_order_of_channels_is_known_to_the_latency_bound(
    tmp_path: Path, before_s: float, verdict: str
):
    entries = [stamped(n, 100 + n, 9 if n == 3 else 1) for n in range(8)]
    entries += stored([Line(3 - before_s, 1, "/alarm")])
    entries.sort(key=lambda item: item.log_ns)
    run = write_mcap(tmp_path / "run.mcap", entries)
    said = check(tmp_path, run, NINE, "--time", "header:header")
    assert said.verdicts == {"P": verdict}, said.out


@pytest.mark.parametrize(("before_s", "verdict"), [(1.5, "inconclusive"), (4, "violated")])
def test_on_a_clock_that_runs_fast_the_order_of_channels_is_known_to_more(
    tmp_path: Path, before_s: float, verdict: str
):
    """It runs ten times as fast, so that two seconds of it are the latency bound; it is told every 0.1 s."""
    entries = [clock(n * 0.01, 50 + n * 0.1) for n in range(200)]
    entries += stored([Line(1.0, 9), Line(1.0 - before_s / 10, 1, "/alarm")])
    entries.sort(key=lambda item: item.log_ns)
    run = write_mcap(tmp_path / "run.mcap", [*stored([Line(-0.001, 1)]), *entries])
    said = check(tmp_path, run, NINE, "--time", "clock")
    assert said.verdicts == {"P": verdict}, said.out


@pytest.mark.parametrize("topic", ["/clock", "/simulation/clock"])
def test_the_time_of_a_simulation_can_be_chosen(tmp_path: Path, topic: str):
    """It runs at a tenth of the speed: a second takes ten."""
    run = write_mcap(
        tmp_path / "run.mcap",
        [
            item
            for n in range(8)
            for item in (
                clock(10 * n, 50 + n, topic),
                *stored([Line(10 * n + 0.5, 9 if n == 3 else 1)]),
            )
        ],
    )
    unsure = check(tmp_path, run, PROPERTIES)
    assert unsure.verdicts["R"] == "inconclusive"
    assert f"time may be that of {topic}, which may stand still or be faster" in unsure.out
    assert check(tmp_path, run, PROPERTIES, "--time", "log").verdicts["R"] == "violated"
    said = check(tmp_path, run, PROPERTIES, "--time", "clock")
    assert (said.code, said.verdicts) == (1, FOUND), said.out
    assert said.time.startswith("that of the simulation's clock")


def test_of_the_times_of_two_simulations_none_can_be_chosen(tmp_path: Path):
    entries = [clock(n, 50 + 10 * (n % 2) + n, f"/robot{n % 2}/clock") for n in range(8)]
    run = write_mcap(tmp_path / "run.mcap", [*entries, *stored([Line(9, 1)])])
    said = check(tmp_path, run, PROPERTIES, "--time", "clock")
    assert said.code == 2
    assert "it has the times of /robot0/clock, /robot1/clock; expected one" in said.out


def test_a_simulation_that_is_set_forward_makes_no_silence(tmp_path: Path):
    entries = []
    for n in range(80):
        time_s = 50 + n * 0.1 + 600 * (n >= 40)
        entries += [clock(n * 0.1, time_s), *stored([Line(n * 0.1 + 0.01, 9 if n == 60 else 1)])]
    said = check(
        tmp_path, write_mcap(tmp_path / "run.mcap", entries), PROPERTIES, "--time", "clock"
    )
    assert said.verdicts["R"] != "violated", said.out
    assert said.verdicts["A"] == "violated", said.out


def test_a_clock_that_is_coarse_is_said_to_be(tmp_path: Path):
    entries = [
        item
        for n in range(8)
        for item in (clock(n, 50 + n), *stored([Line(n + 0.5, 9 if n == 3 else 1)]))
    ]
    said = check(
        tmp_path, write_mcap(tmp_path / "run.mcap", entries), PROPERTIES, "--time", "clock"
    )
    assert "the time of the simulation's clock is known to 1.0 s only" in said.out


@pytest.mark.parametrize("ahead_s", [-HOUR, 1.0])
def test_a_recorder_that_is_set_forward_makes_no_silence(tmp_path: Path, ahead_s: float):
    """Publishers have another clock, which goes on as before; of those without a stamp it is a pause."""
    lines = [
        Line(n * 0.5 + HOUR * (n >= 20), 9 if n == 30 else 1, published_s=n * 0.5 + ahead_s)
        for n in range(40)
    ]
    run = foreign_mcap(tmp_path, lines)
    said = check(tmp_path, run, PROPERTIES)
    assert said.time.startswith("log_time")
    assert said.verdicts["R"] != "violated", said.out
    assert said.verdicts["A"] == "violated", said.out
    silent = [
        line if line.at_s < HOUR else Line(line.at_s, 1, published_s=line.published_s + HOUR)
        for line in lines
    ]
    assert check(tmp_path, foreign_mcap(tmp_path, silent), PROPERTIES).verdicts["R"] == "violated"


@pytest.mark.parametrize("is_unset", [lambda n: n == 0, lambda n: n % 3 == 1, lambda n: n == 7])
def test_a_header_that_nobody_stamped_is_none(tmp_path: Path, is_unset: Callable[[int], bool]):
    run = write_mcap(
        tmp_path / "run.mcap",
        [stamped(n, 0 if is_unset(n) else 100 + n, 9 if n == 3 else 1) for n in range(8)],
    )
    said = check(tmp_path, run, PROPERTIES, "--time", "header:header")
    assert (said.code, said.verdicts) == (1, FOUND), said.out


def test_headers_that_matter_to_nobody_tell_nothing(tmp_path: Path):
    messages = []
    for n in range(8):
        level = stamped(n, 100 + n, 9 if n == 3 else 1)
        camera = stamped(n + 0.1, 1_700_000_000 - 50 * n, 1)
        there = Stored(
            "/camera", camera.log_ns, camera.log_ns, camera.data, camera.type_name, HEADER
        )
        messages += [level, there, *stored([Line(n + 0.2, 1, "/go")])]
    run = write_mcap(tmp_path / "run.mcap", messages)
    once = "  - {id: P, pattern: precedence, cause: lv, effect: go, within: 300 ms}\n"
    said = check(tmp_path, run, PROPERTIES + once, "--time", "header:header")
    assert (said.code, said.verdicts) == (1, {**FOUND, "P": "conforming"}), said.out


def test_headers_that_are_all_unset_are_no_time(tmp_path: Path):
    run = write_mcap(tmp_path / "run.mcap", [stamped(n, 0, 1) for n in range(8)])
    said = check(tmp_path, run, PROPERTIES, "--time", "header:header")
    assert said.code == 2
    assert "no message has a field header with a stamp; expected --time log" in said.out


@pytest.mark.parametrize("behind_s", [1.3, 5, 12, 90, 1_700_000_000])
def test_headers_of_clocks_that_differ_are_no_time(tmp_path: Path, behind_s: float):
    """Two sensors in turns, and one of which the clock is set back."""
    for is_behind in (lambda n: n % 2, lambda n: n > 4):
        run = write_mcap(
            tmp_path / "run.mcap",
            [stamped(n, 1_700_000_100 + n - behind_s * is_behind(n), 1) for n in range(8)],
        )
        said = check(tmp_path, run, PROPERTIES, "--time", "header:header")
        assert said.code == 2, said.out
        assert "its stamps in header go back by " in said.out
        assert "of clocks that differ, or of one that was set; expected --time log" in said.out


@pytest.mark.parametrize("form", [*FOREIGN, ours])
@pytest.mark.parametrize(
    ("choice", "why"),
    [
        ("header:stamp", "no message has a field stamp with a stamp"),
        ("clock", "no time on /clock was recorded"),
    ],
)
def test_a_time_that_is_not_there_is_one_error(tmp_path: Path, form: Form, choice: str, why: str):
    said = check(tmp_path, form(tmp_path, levels()), PROPERTIES, "--time", choice)
    assert said.code == 2
    (line,) = said.out.splitlines()
    assert line.startswith("error: ")
    assert line.endswith(f": {why}; expected --time log or --time publish")


def test_a_bag_without_times_of_publication_says_so(tmp_path: Path):
    said = check(tmp_path, sqlite_bag(tmp_path, levels()), PROPERTIES, "--time", "publish")
    assert said.code == 2
    assert "it has no publish_time" in said.out


@pytest.mark.parametrize("text", ["", "never", "header", "header:", "header:a..b", "log:x"][1:])
def test_a_time_that_cannot_be_is_a_wrong_option(tmp_path: Path, text: str):
    said = check(tmp_path, json_lines(tmp_path, levels()), PROPERTIES, "--time", text)
    assert said.code == 2
    assert "expected log, publish, header:FIELD or clock" in said.out


@pytest.mark.parametrize("form", [*FOREIGN, ours])
def test_a_part_can_be_chosen(tmp_path: Path, form: Form):
    run = form(tmp_path, levels())
    for options, expected in (
        (("--from", "4"), "conforming"),
        (("--to", "2.9"), "conforming"),
        (("--from", "2", "--to", "4"), "violated"),
        (("--from", "2023-11-14T22:13:24+00:00"), "conforming"),
        (("--from", str(T0 // NS + 3)), "violated"),
        (("--to", str(T0 // NS + 2)), "conforming"),
    ):
        said = check(tmp_path, run, PROPERTIES, *options)
        assert said.verdicts == {"A": expected, "R": "conforming"}, (options, said.out)
    said = check(tmp_path, run, PROPERTIES, "--from", "100")
    assert said.code == 2
    assert "nothing is in that part of it" in said.out
    assert check(tmp_path, run, PROPERTIES, "--from", "soon").code == 2
    said = check(tmp_path, run, PROPERTIES, "--from", "4", "--to", "2")
    assert (said.code, said.out.count("--from is after --to")) == (2, 1)


@pytest.mark.parametrize("form", [*FOREIGN, ours])
def test_what_is_left_out_may_have_been_anything(tmp_path: Path, form: Form):
    """What happened before the part is no silence: the run did not begin there."""
    lines = [Line(0.5, 1, "/go"), Line(1.1, 1, "/alarm"), Line(2.0, 9)]
    lines += [Line(n, n == 4, "/alarm" if n > 4 else LEVEL) for n in range(3, 9)]
    run = form(tmp_path, lines)
    properties = (
        "  - {id: P, pattern: precedence, cause: go, effect: alarm}\n"
        "  - {id: W, pattern: precedence, cause: go, effect: alarm, within: 2 s}\n"
        '  - {id: F, formula: "historically({alarm} -> once[:6]{go})"}\n'
        "  - {id: A, pattern: absence, of: level == 1, before: alarm}\n"
    )
    said = check(tmp_path, run, properties)
    assert said.verdicts == {"P": "conforming", "W": "violated", "F": "violated", "A": "conforming"}
    for options in (("--from", "2.5"), ("--from", "1", "--to", "6")):
        said = check(tmp_path, run, properties, *options)
        assert said.verdicts["P"] == "inconclusive", said.out
        assert said.verdicts["W"] == "violated", said.out  # whatever was before the part
        assert said.verdicts["A"] != "violated", said.out
    assert check(tmp_path, run, properties, "--to", "6").verdicts["F"] == "conforming"
    assert (
        check(tmp_path, run, properties, "--from", "3", "--to", "6").verdicts["F"] == "inconclusive"
    )


@pytest.mark.parametrize("data", [b"", b"\0\1\0\0\1", b"\0\1"])
@pytest.mark.parametrize("damaged", [1, 3, 7])
def test_a_message_that_cannot_be_decoded_is_no_silence(tmp_path: Path, damaged: int, data: bytes):
    messages = stored(levels(-0.001))
    it = messages[damaged]
    messages[damaged] = Stored(it.topic, it.log_ns, it.publish_ns, data)
    for time in ("log", "publish"):
        said = check(
            tmp_path,
            write_mcap(tmp_path / "run.mcap", messages),
            PROPERTIES + "  - {id: M, pattern: absence, of: level >= 20}\n",
            "--time",
            time,
        )
        assert "violated" not in {said.verdicts["R"], said.verdicts["M"]}, said.out
        assert (said.verdicts["A"] == "violated") == (damaged != 3)
        assert "could not decode 1 message on /level" in said.out


def test_what_is_silent_until_the_chosen_end_is_found(tmp_path: Path):
    run = json_lines(tmp_path, [Line(0, 0, "/alarm"), Line(1, 1, "/go"), Line(5, 1)])
    assert check(tmp_path, run, RESPONSE, "--to", "1.4").verdicts == {"R": "conforming"}
    assert check(tmp_path, run, RESPONSE, "--to", "1.6").verdicts == {"R": "inconclusive"}
    assert check(tmp_path, run, RESPONSE, "--to", "1.8").verdicts == {"R": "violated"}


def test_a_property_can_be_chosen(tmp_path: Path):
    run = json_lines(tmp_path, levels())
    assert check(tmp_path, run, PROPERTIES, "--property", "R").verdicts == {"R": "conforming"}
    said = check(tmp_path, run, PROPERTIES, "--property", "RR")
    assert said.code == 2
    assert "there is no property RR; did you mean R?" in said.out or "known: A, R" in said.out


def test_a_page_shows_what_was_judged_at_the_times_at_which_it_was(tmp_path: Path):
    run = write_mcap(
        tmp_path / "run.mcap", [stamped(n, 100 + n, 9 if n == 3 else 1) for n in range(8)]
    )
    file, page = tmp_path / "properties.yaml", tmp_path / "page.html"
    file.write_text(PORTS + PROPERTIES)
    subject = Subject((), (file,), (), (), (), Bounds())
    view = View(TimeChoice("header", "header"), instant("2"), instant("5"))
    result = check_recording(run, subject, read_subject(subject), True, view=view)
    shown = list(result.entries(open_recording(run)))
    assert [seen.received_ns for seen in shown] == [(100 + n) * NS for n in (2, 3, 4, 5)]
    assert (result.recording.first_ns, result.recording.last_ns) == (102 * NS, 105 * NS)
    write_report(result, page)
    assert "time: header of messages" in page.read_text()
