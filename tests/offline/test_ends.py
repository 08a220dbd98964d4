"""A recording begins with its first entry and ends with its last: what lies between is judged, nothing else."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.offline.logs import FOREIGN, FORMS, Form, Line, check

NINE = "  - {id: A, pattern: absence, of: level >= 9}\n"
FAST = """\
  - {id: rec, pattern: recurrence, of: lv, within: 100 ms}
  - {id: exi, pattern: existence, of: lv, within: 100 ms}
  - {id: once, formula: "historically(once[:0.1]{lv})"}
"""
RESPONSE = "  - {id: R, pattern: response, request: go, response: alarm, within: 500 ms}\n"


@pytest.mark.parametrize("form", FORMS)
def test_what_precedes_a_crash_is_found(tmp_path: Path, form: Form):
    run = form(tmp_path, [Line(0, 1), Line(1, 1), Line(1.05, 9)])
    said = check(tmp_path, run, NINE)
    assert (said.code, said.verdicts) == (1, {"A": "violated"}), said.out
    assert check(tmp_path, run, NINE, "--strict").code == 1


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("last_s", [0.51, 0.6, 0.69, 0.71])
def test_what_was_due_before_the_last_entry_and_is_not_there_is_found(
    tmp_path: Path, form: Form, last_s: float
):
    """Where only times of reception are known, what was due a latency bound before it."""
    lines = [Line(-1, 0, "/alarm"), Line(-0.5, 1), Line(0, 1, "/go"), Line(last_s, 2)]
    said = check(tmp_path, form(tmp_path, lines), RESPONSE)
    is_open = form in FOREIGN and last_s < 0.7
    expected = (0, {"R": "inconclusive"}) if is_open else (1, {"R": "violated"})
    assert (said.code, said.verdicts) == expected, said.out


@pytest.mark.parametrize("form", FORMS)
def test_what_is_due_after_the_last_entry_is_open(tmp_path: Path, form: Form):
    lines = [Line(-1, 0, "/alarm"), Line(-0.5, 1), Line(0, 1, "/go"), Line(0.49, 2)]
    said = check(tmp_path, form(tmp_path, lines), RESPONSE, "--strict")
    assert (said.code, said.verdicts) == (0, {"R": "conforming"}), said.out


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("period_s", [0.02, 0.05, 0.1])
def test_nothing_is_missed_before_the_first_entry(tmp_path: Path, form: Form, period_s: float):
    run = form(tmp_path, [Line(n * period_s, n) for n in range(60)])
    said = check(tmp_path, run, FAST, "--strict")
    assert said.code == 0, said.out
    assert set(said.verdicts.values()) == {"conforming"}


@pytest.mark.parametrize("form", FOREIGN)
def test_a_silence_in_the_middle_is_found_all_the_same(tmp_path: Path, form: Form):
    times = [n * 0.05 for n in range(20)] + [1.3 + n * 0.05 for n in range(20)]
    said = check(tmp_path, form(tmp_path, [Line(t, 1) for t in times]), FAST)
    assert said.verdicts == {"rec": "violated", "exi": "conforming", "once": "violated"}


@pytest.mark.parametrize("form", FOREIGN)
def test_a_silence_at_the_beginning_is_found(tmp_path: Path, form: Form):
    lines = [Line(0, 1, "/go"), *(Line(0.4 + n * 0.05, 1) for n in range(20))]
    said = check(tmp_path, form(tmp_path, lines), FAST)
    assert said.verdicts == {"rec": "violated", "exi": "violated", "once": "violated"}


@pytest.mark.parametrize("form", FORMS)
def test_one_entry_is_a_recording_too(tmp_path: Path, form: Form):
    said = check(tmp_path, form(tmp_path, [Line(0, 9)]), NINE)
    assert said.verdicts == {"A": "violated"}, said.out
