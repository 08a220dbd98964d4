"""``moon replay`` on the command line: its page, its refusals."""

from __future__ import annotations

import re
from pathlib import Path

import click
import pytest
from click.testing import CliRunner
from rosbags.rosbag2 import StoragePlugin, Writer

from moon.cli import main
from moon.replay.command import replay
from tests.recording import bags

PAGE = (Path(__file__).parents[2] / "docs" / "commands" / "moon-replay.md").read_text("utf-8")
OPTIONS = {name for item in replay.params if isinstance(item, click.Option) for name in item.opts}


@pytest.mark.parametrize("option", sorted(OPTIONS))
def test_the_page_has_a_row_for_the_option(option: str):
    assert re.search(rf"^\| `{option}\b", PAGE, re.MULTILINE)


def test_the_page_names_no_option_that_there_is_not():
    assert set(re.findall(r"`(--[a-z-]+)", PAGE)) <= OPTIONS | {"--help"}


def refused(*arguments: object) -> str:
    result = CliRunner().invoke(main, ["replay", *map(str, arguments)])
    assert result.exit_code == 2, result.output
    assert "Traceback" not in result.output
    return result.output


def test_what_is_no_recording_is_refused(tmp_path: Path):
    assert "No such file" in refused(tmp_path / "nothing.mcap")
    (tmp_path / "empty.mcap").write_bytes(b"")
    assert "is empty (0 bytes)" in refused(tmp_path / "empty.mcap")


def test_a_node_that_is_not_in_it_is_refused_with_those_that_are(tmp_path: Path):
    folder = bags.write(tmp_path / "bag", bags.levels(2))
    assert "no node A in it; there are: none by name" in refused(folder, "--as", "A")


def test_a_recording_of_nothing_that_can_be_replayed_is_refused(tmp_path: Path):
    rosout = bags.Stored(
        "/parameter_events", "std_msgs/msg/Int32", bags.T0, bags.new("std_msgs/msg/Int32", 1)
    )
    assert "nothing in it can be replayed" in refused(bags.write(tmp_path / "bag", [rosout]))


@pytest.mark.parametrize("plugin", list(StoragePlugin))
def test_a_recording_without_messages_is_refused(tmp_path: Path, plugin: StoragePlugin):
    writer = Writer(tmp_path / "bag", version=9, storage_plugin=plugin)
    with writer:
        writer.add_connection("/level", "std_msgs/msg/Int32", msgdef="int32 data\n", rihs01="x")
    assert "nothing in it can be replayed" in refused(tmp_path / "bag")


def test_an_action_of_which_nothing_was_recorded_but_its_status_is_refused(tmp_path: Path):
    status = bags.Stored(
        "/go/_action/status", "std_msgs/msg/Int32", bags.T0, bags.new("std_msgs/msg/Int32", 1)
    )
    assert "nothing in it can be replayed" in refused(bags.write(tmp_path / "bag", [status]))


def test_a_channel_that_can_match_nothing_is_refused(tmp_path: Path):
    assert "'level' matches no channel" in refused(tmp_path, "--only", "level")


def test_the_simulated_transport_is_not_reached_from_here(tmp_path: Path):
    assert "that world is in one process" in refused(tmp_path, "--transport", "simulated")


def test_a_rate_of_nothing_is_refused(tmp_path: Path):
    for rate in (0, -1, "nan", 1001):
        refused(tmp_path, "--rate", rate)
