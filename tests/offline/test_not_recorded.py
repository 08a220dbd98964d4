"""What was not recorded is a limit: nothing is concluded from its absence."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.offline.logs import (
    FOREIGN,
    FORMS,
    Form,
    Line,
    check,
    killed,
    ours,
    stored,
    write_ours,
)

SWITCH = """\
  - {id: never, pattern: absence, of: alarm}
  - {id: must, pattern: existence, of: alarm, within: 2 s}
  - {id: then, pattern: response, request: go, response: alarm, within: 500 ms}
  - {id: level, pattern: universality, of: level < 9}
"""
RUN = [Line(0, 1, "/go"), *(Line(n + 0.1, 1) for n in range(5))]


@pytest.mark.parametrize("form", FOREIGN)
def test_a_topic_that_was_not_recorded_is_a_limit_and_an_error_if_strict(
    tmp_path: Path, form: Form
):
    run = form(tmp_path, RUN)
    said = check(tmp_path, run, SWITCH)
    assert (said.code, said.verdicts) == (
        0,
        {
            "never": "inconclusive",
            "must": "inconclusive",
            "then": "inconclusive",
            "level": "conforming",
        },
    ), said.out
    (limit,) = [line for line in said.limits if line.startswith("/alarm ")]
    assert limit.startswith("/alarm was not recorded: what depends on it cannot be known")
    assert "(never, must, then)" in limit
    said = check(tmp_path, run, SWITCH, "--strict")
    assert said.code == 1
    assert f"strict: {run}: not recorded: /alarm" in said.out


@pytest.mark.parametrize("form", FORMS)
def test_a_name_that_is_mistyped_is_told(tmp_path: Path, form: Form):
    properties = (
        "ports:\n  lvl: {topic: /levl}\nproperties:\n"
        "  - {id: R, pattern: recurrence, of: lvl, within: 1 s}\n"
    )
    said = check(tmp_path, form(tmp_path, RUN), properties)
    assert said.verdicts == {"R": "inconclusive"}, said.out
    (limit,) = [line for line in said.limits if line.startswith("/levl ")]
    assert limit.endswith("did you mean /level?")


@pytest.mark.parametrize("form", [ours, killed])
def test_on_what_moon_would_have_recorded_nothing_happened_and_that_is_said(
    tmp_path: Path, form: Form
):
    said = check(tmp_path, form(tmp_path, RUN), SWITCH)
    assert said.verdicts == {
        "never": "conforming",
        "must": "violated",
        "then": "violated",
        "level": "conforming",
    }, said.out
    assert any(limit.startswith("nothing was recorded on /alarm") for limit in said.limits)


@pytest.mark.parametrize("globs", [("/level", "/go"), ("/l*", "/**/go")])
def test_what_moon_was_not_to_record_is_a_limit(tmp_path: Path, globs: tuple[str, ...]):
    run = write_ours(tmp_path / "ours.mcap", RUN, globs=globs)
    said = check(tmp_path, run, SWITCH, "--strict")
    assert (said.code, said.verdicts["must"]) == (1, "inconclusive"), said.out
    assert f"strict: {run}: not recorded: /alarm" in said.out


@pytest.mark.parametrize("form", FORMS)
def test_a_violation_that_rests_on_nothing_missing_is_one(tmp_path: Path, form: Form):
    properties = "  - {id: both, pattern: absence, of: go || alarm}\n"
    said = check(tmp_path, form(tmp_path, RUN), properties)
    assert (said.code, said.verdicts) == (1, {"both": "violated"}), said.out


def test_a_topic_that_was_recorded_and_silent_is_known_to_be(tmp_path: Path):
    from mcap.writer import Writer

    path = tmp_path / "silent.mcap"
    with path.open("wb") as opened:
        writer = Writer(opened)
        writer.start(profile="ros2", library="another")
        schema = writer.register_schema("std_msgs/msg/Int32", "ros2msg", b"int32 data\n")
        numbers = {
            topic: writer.register_channel(topic, "cdr", schema)
            for topic in ("/go", "/level", "/alarm")
        }
        for item in stored(RUN):
            writer.add_message(numbers[item.topic], item.log_ns, item.data, item.publish_ns)
        writer.finish()
    said = check(tmp_path, path, SWITCH)
    assert said.verdicts == {
        "never": "conforming",
        "must": "violated",
        "then": "violated",
        "level": "conforming",
    }, said.out


@pytest.mark.parametrize("form", FOREIGN)
def test_topics_without_a_slash_are_the_same(tmp_path: Path, form: Form):
    lines = [Line(n, 9 if n == 3 else 1, "level") for n in range(5)]
    said = check(tmp_path, form(tmp_path, lines), "  - {id: A, pattern: absence, of: level >= 9}\n")
    assert (said.code, said.verdicts) == (1, {"A": "violated"}), said.out
