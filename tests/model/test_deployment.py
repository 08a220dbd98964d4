"""``<deployment>`` in a system file, and in a file of its own."""

from __future__ import annotations

from pathlib import Path

import pytest

from m2c.model import DiagnosticLog, load
from m2c.model.deployment import Process, hosts_of, read_deployment_file

NAMES = ["A", "B", "policy"]
ALL = '<process name="all"><node name="A"/><node name="B"/><node name="policy"/></process>'


def whole(processes: str) -> str:
    return f"<deployment>{processes}</deployment>"


def read(tmp_path: Path, text: str) -> tuple[tuple[Process, ...], list[str]]:
    file = tmp_path / "deployment.xml"
    file.write_text(text)
    log = DiagnosticLog()
    found = read_deployment_file(file, NAMES, log)
    return found, [str(d).removeprefix(f"{tmp_path}/") for d in log.diagnostics]


def test_it_says_who_shares_a_process_where_it_runs_and_how_urgent_it_is(tmp_path: Path) -> None:
    found, faults = read(
        tmp_path,
        '<deployment><process name="x" host="robot" priority="-5"><node name="B"/><node name="A"/></process>'
        '<process name="y" host="base"><node name="policy"/></process></deployment>',
    )
    assert faults == []
    assert found == (
        Process(name="x", nodes=("B", "A"), host="robot", priority=-5),
        Process(name="y", nodes=("policy",), host="base"),
    )
    assert hosts_of(found) == ["robot", "base"]


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("<deployments/>", "1:1: error: <deployments>: not a deployment; the root is <deployment>"),
        ("<deployment/>", "1:1: error: <deployment>: it gives no process to A, B, policy"),
        (
            f'<deployment>{ALL}<process name="more"><node name="A"/></process></deployment>',
            "`A` has two processes; also at",
        ),
        (f'<deployment>{ALL}<process name="more"/></deployment>', "a process without nodes"),
        (f"<deployment>{ALL}{ALL}</deployment>", "two processes are named `all`"),
        (
            f"<deployment>{ALL.replace('<node ', '<nod ', 1)}</deployment>",
            "<nod>: not an element of <process>; use <node>",
        ),
        (
            f"<deployment>{ALL.replace('name=', 'nam=', 1)}</deployment>",
            "unknown attribute `nam`; did you mean name?",
        ),
        (
            whole(ALL.replace('"A"', '"AA"')),
            "the system has no node `AA`; did you mean A?",
        ),
        (
            whole(ALL.replace('"all"', '"../all"')),
            "`../all` is no name; letters, digits",
        ),
        (
            whole(ALL.replace('"all"', '"all" host="a b"')),
            "`a b` is no name; letters, digits",
        ),
        *(
            (
                whole(ALL.replace('"all"', f'"all" priority="{wrong}"')),
                f"`{wrong}` is no priority; a nice value from -20, the most urgent, to 19",
            )
            for wrong in ("20", "-21", "high", "1.0", "٣", "999999999999")
        ),
        (
            '<deployment><process name="x" host="h"><node name="A"/></process>'
            '<process name="y"><node name="B"/><node name="policy"/></process></deployment>',
            "the process `y` has no host, and others have; hosts are h",
        ),
    ],
)
def test_what_is_wrong_is_said_with_its_place(tmp_path: Path, text: str, fault: str) -> None:
    _, faults = read(tmp_path, text)
    assert any(fault in said for said in faults), faults
    assert all(said.startswith("deployment.xml:1:") for said in faults)


def test_a_system_file_has_one_at_most(tmp_path: Path) -> None:
    (tmp_path / "a.scxml").write_text(
        '<scxml xmlns="http://www.w3.org/2005/07/scxml" name="A" initial="s"><state id="s"/></scxml>'
    )
    one = '<deployment><process name="p"><node name="A"/></process></deployment>'
    system = '<roaml><node_models><input type="node-ascxml" src="a.scxml"/></node_models>{}</roaml>'
    file = tmp_path / "system.xml"
    file.write_text(system.format(one))
    log = DiagnosticLog()
    read_system = load([file], log)
    assert read_system is not None
    assert read_system.deployment == (Process(name="p", nodes=("A",)),)
    file.write_text(system.format(one + one))
    load([file], log)
    assert [d.rule for d in log.diagnostics] == ["bad-deployment"]
