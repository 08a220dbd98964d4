"""A transport that somebody else installs is found, passes the suite, and runs generated nodes."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

TINY = Path(__file__).parent / "tiny"
ROOT = Path(__file__).parents[2]

PROGRAM = """
import sys
from transports.conformance import CHECKS
from transports.networks import ThreadedNetwork
from transports.registry import available, connect

assert "tiny" in available(), available()
for check in CHECKS:
    network = ThreadedNetwork(lambda name, others: connect("tiny", name, {}))
    try:
        check(network)
    finally:
        network.close()
print(len(CHECKS), "checks")
"""


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """The environment of a process in which the tiny transport is installed."""
    source = tmp_path_factory.mktemp("source")
    for path in TINY.iterdir():
        if path.is_file():
            (source / path.name).write_bytes(path.read_bytes())
    target = tmp_path_factory.mktemp("installed")
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    subprocess.run(
        [*pip, "--no-build-isolation", "--no-deps", "--target", str(target), str(source)],
        check=True,
    )
    return {**os.environ, "PYTHONPATH": os.pathsep.join([str(target), str(ROOT)])}


def run(environment: dict[str, str], *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, *arguments],
        env=environment,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


def test_it_passes_the_conformance_suite(installed: dict[str, str]) -> None:
    done = run(installed, "-c", PROGRAM)
    assert done.returncode == 0, done.stderr
    assert "checks" in done.stdout


def test_its_own_option_error_reaches_the_user_of_a_command(installed: dict[str, str]) -> None:
    done = run(installed, "-m", "moon.cli", "tap", "--transport", "tiny", "--endpoint", "x")
    assert done.returncode == 2, done.stderr
    assert "the tiny transport has no option `endpoint`" in done.stderr


def test_a_name_that_it_does_not_take_is_refused_where_it_is_chosen(
    installed: dict[str, str], tmp_path: Path
) -> None:
    model = tmp_path / "m.scxml"
    model.write_text(
        '<scxml xmlns="http://www.w3.org/2005/07/scxml" name="LargeTank"><state id="a"/></scxml>'
    )
    done = run(installed, "-m", "m2c.cli", "check", "--transport", "tiny", str(model))
    assert done.returncode == 2, done.stderr
    assert (
        "the tiny transport does not take the name of a node `LargeTank`: it has 9" in done.stdout
    )
    assert "write LargeTan [bad-name]" in done.stdout
    done = run(installed, "-m", "m2c.cli", "check", str(model))
    assert (done.returncode, "[unportable-name]" in done.stdout) == (0, True)


def test_without_it_the_error_names_what_is_installed() -> None:
    done = run({**os.environ}, "-m", "moon.cli", "tap", "--transport", "tiny")
    assert done.returncode == 2
    assert "no transport `tiny` is installed; installed: " in done.stderr
