"""``--version`` says what is installed, and ``NO_COLOR`` is obeyed by all that is coloured."""

from __future__ import annotations

import importlib.metadata
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

from m2c.cli import main as m2c
from moon.cli import main as moon
from tests.commands.on_terminal import OnTerminal
from transports.registry import available


@pytest.mark.parametrize(("group", "name"), [(m2c, "m2c"), (moon, "moon")])
def test_the_version_has_python_and_each_transport_with_its_library(
    group: object, name: str
) -> None:
    done = CliRunner().invoke(group, ["--version"])  # type: ignore[arg-type]
    assert done.exit_code == 0
    first, *others, last = done.output.splitlines()
    own = importlib.metadata.version("m2c-moon")
    assert first == f"{name} {own} (Python {'.'.join(map(str, sys.version_info[:3]))})"
    assert [line.split()[1].rstrip(":") for line in others] == available()
    assert f"transport zenoh: eclipse-zenoh {importlib.metadata.version('eclipse-zenoh')}" in others
    assert "transport simulated" in others
    assert last in ("monitors compiled", "monitors not compiled")


def test_a_library_that_is_not_installed_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    found = importlib.metadata.version

    def without(name: str) -> str:
        if name == "rclpy":
            raise importlib.metadata.PackageNotFoundError(name)
        return found(name)

    monkeypatch.setattr(importlib.metadata, "version", without)
    assert "transport ros2: rclpy is not installed" in CliRunner().invoke(m2c, ["--version"]).output


MODEL = '<scxml version="1.0" name="M" initial="s"><state id="s"/><nothing/></scxml>'


@pytest.mark.slow
@pytest.mark.parametrize("value", ["1", "true", ""])
def test_no_color_takes_colours_away_unless_it_is_empty(tmp_path: Path, value: str) -> None:
    model = tmp_path / "model.scxml"
    model.write_text(MODEL)
    run = OnTerminal(
        "/usr/bin/env", f"NO_COLOR={value}", sys.executable, "-m", "m2c.cli", "check", model
    )
    run.end()
    assert "error:" in run.text or "warning:" in run.text
    assert ("\x1b[" in run.text) == (not value)
