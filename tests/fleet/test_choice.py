"""Which robots a monitor of a fleet takes."""

from __future__ import annotations

import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

from moon.cli import main
from moon.fleet.choice import WHOLE, ChoiceError, Shard, fleet_pattern, read_shard
from tests.systems import EXAMPLES, LAB_TOUR

SYSTEM = str(EXAMPLES / LAB_TOUR / "system.xml")


@pytest.mark.parametrize("text", ["robots/*", "r*", "*/*", "site-a/robot*7", "robots/r1"])
def test_a_pattern_has_parts_with_a_star_for_anything_in_one(text: str) -> None:
    assert fleet_pattern(text) == text
    assert fleet_pattern(f"/{text}/") == text


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", "it is empty"),
        ("/", "it is empty"),
        ("robots//x", "empty part"),
        ("robots/**", "within one part"),
        ("robots/$*", "'$' is not allowed"),
        ("robots/#", "'#' is not allowed"),
        ("robots/\n", r"'\n' is not allowed"),
        ("robots/@m2c", "may not start with '@'"),
    ],
)
def test_what_is_no_pattern_is_refused_with_an_example(text: str, why: str) -> None:
    with pytest.raises(ChoiceError, match="as robots/\\* is: ") as caught:
        fleet_pattern(text)
    assert why in str(caught.value)


@pytest.mark.parametrize("text", ["", "2", "0/4", "5/4", "1/0", "-1/4", "1/4/2", "a/b", "1.0/2"])
def test_what_is_no_share_is_refused(text: str) -> None:
    with pytest.raises(ChoiceError, match="write K/N"):
        read_shard(text)


@given(st.text(), st.integers(1, 50))
def test_each_robot_belongs_to_exactly_one_share(robot: str, of: int) -> None:
    takers = [number for number in range(1, of + 1) if Shard(number, of).takes(robot)]
    assert len(takers) == 1
    assert WHOLE.takes(robot)


def test_shares_are_about_equal_and_the_same_on_every_host() -> None:
    robots = [f"robots/r{number}" for number in range(1000)]
    sizes = [sum(map(read_shard(f"{k}/4").takes, robots)) for k in range(1, 5)]
    assert sum(sizes) == 1000
    assert all(200 < size < 300 for size in sizes)
    assert [robot for robot in robots[:10] if read_shard("1/2").takes(robot)] == TAKEN


TAKEN = ["robots/r0", "robots/r1", "robots/r5", "robots/r8", "robots/r9"]
"""What a hash says does not change from version to version: monitors of several may run side by side."""


@pytest.mark.parametrize(
    ("options", "why"),
    [
        (["--fleet", "robots//x"], "empty part"),
        (["--fleet", "robots/*", "--shard", "5/4"], "write K/N"),
        (["--shard", "1/2"], "give --fleet, too"),
        (["--fleet", "robots/*", "--transport", "ros2"], "start one for each robot"),
        (["--fleet", "robots/*", "--namespace", "x"], "give one of the two"),
        (["--fleet", "robots/*", "--record", "file.mcap"], "moon record --namespace"),
        (["--fleet", "robots/*", "--secure", "keys"], "are for one robot"),
    ],
)
def test_bad_options_are_one_error(options: list[str], why: str) -> None:
    result = CliRunner().invoke(main, ["monitor", SYSTEM, *options])
    assert result.exit_code == 2
    assert result.stderr.count("Error:") == 1
    assert why in result.stderr
    assert "Traceback" not in result.stderr
