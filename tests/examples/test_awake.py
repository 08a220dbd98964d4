"""Processors are held awake where that is permitted, and it is said where it is not."""

from __future__ import annotations

import struct
from pathlib import Path

import pytest

from examples.overhead.machine import described, held_awake


def open_files() -> set[Path]:
    return {item.resolve() for item in Path("/proc/self/fd").iterdir()}


def test_the_bound_holds_until_the_end_of_the_block(tmp_path: Path) -> None:
    device = tmp_path / "latency"
    device.write_bytes(b"")
    with held_awake(device=device) as is_awake:
        assert is_awake
        assert struct.unpack("i", device.read_bytes()) == (0,)
        assert device in open_files()  # it counts for as long as it is open
    assert device not in open_files()


@pytest.mark.parametrize("wanted", [True, False])
def test_where_it_cannot_be_had_or_is_not_wanted_nothing_is_done(
    tmp_path: Path, wanted: bool
) -> None:
    device = tmp_path / "latency"
    if not wanted:
        device.write_bytes(b"")
    with held_awake(wanted, device) as is_awake:
        assert not is_awake
    assert device.exists() != wanted
    assert wanted or device.read_bytes() == b""


def test_an_error_of_the_block_is_not_taken_for_one_of_the_device(tmp_path: Path) -> None:
    device = tmp_path / "latency"
    device.write_bytes(b"")
    with pytest.raises(OSError, match="of the block"), held_awake(device=device):
        raise OSError("of the block")


@pytest.mark.parametrize(
    ("is_awake", "said"), [(True, "held awake"), (False, "that sleep when idle")]
)
def test_it_is_said_of_the_machine(is_awake: bool, said: str) -> None:
    assert f"cores {said}, " in described(is_awake)
