"""Types of which a bag stores the definition in other ways than rosbag2 mostly does."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.offline.logs import Line, Stored, cdr, check, stored, write_mcap

CALL = """\
ports:
  dock: {service: /dock, on: request}
  done: {service: /dock, on: response, field: success}
properties:
  - {id: never, pattern: absence, of: dock}
"""
SRV = "bool data\n---\nbool success\n"
EVENT = bytes.fromhex(
    "000100000000000002f153650000000001010101010101010101010101010101"
    "000000000200000000000000010000000100000000000000"
)


@pytest.mark.parametrize("newline", ["\n", "\r\n"])
@pytest.mark.parametrize("encoding", ["unknown", "ros2msg", ""])
@pytest.mark.parametrize("head", ["=" * 80 + "\nSRV: my_pkg/srv/Dock\n", ""])
def test_a_service_is_defined_by_its_whole_text_too(
    tmp_path: Path, newline: str, encoding: str, head: str
):
    text = (head + SRV).replace("\n", newline)
    at_ns = stored([Line(0, 1)])[0].log_ns
    event = Stored(
        "/dock/_service_event", at_ns, at_ns, EVENT, "my_pkg/srv/Dock_Event", text, encoding
    )
    run = write_mcap(tmp_path / "run.mcap", [event])
    said = check(tmp_path, run, CALL)
    assert (said.code, said.verdicts) == (1, {"never": "violated"}), said.out


@pytest.mark.parametrize("encoding", ["unknown", "ros2msg", ""])
def test_definitions_may_have_the_line_ends_of_another_system(tmp_path: Path, encoding: str):
    text = "# what is left\r\nint32 data  # in percent\r\n\r\nint32 MOST=100\r\n"
    at_ns = stored([Line(0, 1)])[0].log_ns
    message = Stored("/level", at_ns, at_ns, cdr(9), "my_pkg/msg/Level", text, encoding)
    run = write_mcap(tmp_path / "run.mcap", [message])
    said = check(tmp_path, run, "  - {id: A, pattern: absence, of: level >= 9}\n")
    assert (said.code, said.verdicts) == (1, {"A": "violated"}), said.out
