"""``m2c check --watch``: checked again whenever a file has changed."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from m2c.check.command import _check_again_and_again
from m2c.inputs import Inputs
from m2c.model import DiagnosticLog, load
from m2c.watched import WatchedFiles

POLICY = (
    '<root BTCPP_format="4"><include path="trees/one.xml"/>'
    '<BehaviorTree ID="M"><AlwaysSuccess/></BehaviorTree></root>'
)
ROOT = Path(__file__).parents[2]
NS = 'xmlns="http://www.w3.org/2005/07/scxml" version="1.0"'
GOOD = f'<scxml {NS} name="Good" initial="a"><state id="a"/></scxml>'
FAILS = f'<scxml {NS} name="Good" initial="z"><state id="a"/></scxml>'
NOT_XML = "<scxml"


def test_a_file_that_has_changed_is_told_once_and_when_it_is_at_rest(tmp_path: Path) -> None:
    model = tmp_path / "model.scxml"
    model.write_text(GOOD)
    (tmp_path / "notes.txt").write_text("1")
    files = WatchedFiles([tmp_path])
    assert files.changed() == []
    model.write_text(FAILS)
    (tmp_path / "notes.txt").write_text("12")
    assert files.changed() == []
    assert files.changed() == [model]
    assert files.changed() == []
    other = tmp_path / "interfaces" / "p" / "msg" / "A.msg"
    other.parent.mkdir(parents=True)
    other.write_text("int32 x\n")
    model.unlink()
    assert files.changed() == []
    other.write_text("int32 xy\n")  # not at rest
    assert files.changed() == []
    assert files.changed() == [other, model]
    files.follow(None)
    assert files.changed() == []


def test_a_file_that_is_not_there_yet_is_watched(tmp_path: Path) -> None:
    files = WatchedFiles([tmp_path / "model.scxml"])
    (tmp_path / "model.scxml").write_text(GOOD)
    assert files.changed() == []
    assert files.changed() == [tmp_path / "model.scxml"]


def test_each_file_of_a_system_is_watched_whether_it_is_there_or_not(tmp_path: Path) -> None:
    system = tmp_path / "system.xml"
    system.write_text(
        '<roaml><behavior_tree><input type="bt.cpp-xml" src="policy.xml"/></behavior_tree>'
        '<node_models><input type="node-ascxml" src="model.scxml"/>'
        '<input type="node-ascxml" src="later.scxml"/></node_models></roaml>'
    )
    (tmp_path / "policy.xml").write_text(POLICY)
    (tmp_path / "trees").mkdir()
    (tmp_path / "trees" / "one.xml").write_text(POLICY.replace("trees/one", "../two"))
    (tmp_path / "model.scxml").write_text(GOOD)
    files = WatchedFiles([system])

    files.follow(load([system], DiagnosticLog()))

    def told() -> list[str]:
        found = [*files.changed(), *files.changed()]
        files.follow(load([system], DiagnosticLog()))
        return [path.name for path in found]

    assert told() == []
    for name in ("trees/one.xml", "two.xml", "later.scxml", "model.scxml", "policy.xml"):
        path = tmp_path / name
        text = path.read_text() if path.exists() else ""
        path.unlink(missing_ok=True)
        assert told() == ([path.name] if text else [])
        path.write_text(text or GOOD)
        files.follow(None)
        assert told() == [path.name], name


def test_it_checks_again_until_ctrl_c(tmp_path: Path) -> None:
    model = tmp_path / "model.scxml"
    model.write_text(GOOD)
    with subprocess.Popen(
        [sys.executable, "-u", "-m", "m2c.cli", "check", "--watch", str(model)],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    ) as process, contextlib.ExitStack() as ended:  # fmt: skip
        ended.callback(process.kill)
        assert process.stdout is not None

        def until(text: str) -> list[str]:
            assert process.stdout is not None
            said: list[str] = []
            for line in process.stdout:
                said.append(line.strip())
                if text in line:
                    return said
            raise AssertionError(said)

        until("1 model, 0 errors, 0 warnings")
        until("watching; Ctrl-C ends it")
        model.write_text(NOT_XML)
        assert until("0 models, 1 error")[0] == "model.scxml has changed:"
        model.write_text(FAILS)
        assert any("error: <scxml>: " in line for line in until("0 models, 1 error"))
        process.send_signal(signal.SIGINT)
        assert "Traceback" not in process.stdout.read()
        assert process.wait(30) == 2


@pytest.fixture
def handler() -> Iterator[None]:
    before = signal.getsignal(signal.SIGINT)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.timeout(30)
def test_ctrl_c_is_not_lost_where_an_exception_is(handler: None, tmp_path: Path) -> None:
    """As in a weak reference's callback, of which Python prints what is raised and goes on."""

    def once() -> tuple[None, int]:
        with contextlib.suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        return None, 2

    with pytest.raises(SystemExit, match="2"):
        _check_again_and_again(Inputs((tmp_path,), ()), once)


def test_ctrl_c_ends_the_first_check_too(handler: None, tmp_path: Path) -> None:
    def once() -> tuple[None, int]:
        signal.raise_signal(signal.SIGINT)
        raise AssertionError("it goes on")

    with pytest.raises(SystemExit, match="2"):
        _check_again_and_again(Inputs((tmp_path,), ()), once)
