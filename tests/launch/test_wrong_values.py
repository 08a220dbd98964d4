"""Wrong values on the command lines of `m2c run`, of a node and of a policy."""

from __future__ import annotations

import argparse
from pathlib import Path

import pytest
from click.testing import CliRunner

from m2c.cli import main
from m2c.runtime.main import add_transport_options, positive


@pytest.mark.parametrize("rate", ["nan", "inf", "0", "-1", "fast"])
def test_a_rate_that_is_none_is_refused_before_anything_starts(rate: str, tmp_path: Path) -> None:
    done = CliRunner().invoke(main, ["run", str(tmp_path), "--rate", rate])
    assert done.exit_code == 2
    assert "Invalid value for '--rate'" in done.output


@pytest.mark.parametrize("text", ["nan", "inf", "0", "-1", "soon", ""])
def test_a_node_refuses_a_number_that_is_no_time_and_no_rate(text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError, match="is not a number above 0"):
        positive(text)


def test_a_node_takes_a_number() -> None:
    assert positive("0.5") == 0.5


def test_a_node_refuses_a_severity_that_is_none(capsys: pytest.CaptureFixture[str]) -> None:
    parser = argparse.ArgumentParser()
    add_transport_options(parser)
    assert parser.parse_args(["--log-level", "debug"]).log_level == "DEBUG"
    with pytest.raises(SystemExit) as ended:
        parser.parse_args(["--log-level", "LOUD"])
    assert ended.value.code == 2
    assert "invalid choice: 'LOUD'" in capsys.readouterr().err
