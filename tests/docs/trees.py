"""Running the trees of the language reference: ``<S/>``, ``<F/>``, ``<R/>`` are leaves with that answer."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from m2c.diagnostics import Severity
from m2c.model import DiagnosticLog, load
from m2c.policy.program import Policy, read_policy
from m2c.policy.runner import PolicyRunner
from tests.policy.test_runner import FakeTransport
from transports.interface import CallOutcome, CallResult

ANSWERS = {"S": 0, "F": 1, "R": 2}
NS = 'xmlns="http://www.w3.org/2005/07/scxml"'
SYSTEM = (
    '<roaml><behavior_tree><input type="bt.cpp-xml" src="policy.xml"/></behavior_tree>'
    "<node_models>{}</node_models></roaml>"
)


class Skills(FakeTransport):
    """Every skill gives its answer, takes a halt, and no time passes."""

    def client(self, service: Any) -> Any:
        if service.name.endswith("/halt"):
            answer = CallResult(CallOutcome.RESPONSE, service.response(is_ok=True))
            return SimpleNamespace(call_and_wait=lambda _request, _timeout_s: answer)
        return super().client(service)

    def after(self, _delay_s: float, _handler: Any) -> Any:
        return SimpleNamespace(cancel=lambda: None)


def skill(name: str) -> str:
    declared = "".join(
        f'<ros_service_server service_name="/{name}/{service}" type="bt_interfaces/{kind}"/>'
        for service, kind in (("tick", "TickAction"), ("halt", "HaltAction"))
    )
    return f'<scxml {NS} name="{name}" initial="a">{declared}<state id="a"/></scxml>'


def with_skills(
    folder: Path, trees: str, skills: Iterable[str]
) -> tuple[Policy | None, DiagnosticLog]:
    """The policy of ``trees``, each a ``<BehaviorTree>``, in a system of ``skills``, and what is found in it."""
    root = '<root BTCPP_format="4" main_tree_to_execute="Main">'
    (folder / "policy.xml").write_text(f"{root}{trees}</root>")
    for name in skills:
        (folder / f"{name}.scxml").write_text(skill(name))
    nodes = "".join(f'<input type="node-ascxml" src="{name}.scxml"/>' for name in skills)
    (folder / "system.xml").write_text(SYSTEM.format(nodes))
    log = DiagnosticLog()
    system = load([folder / "system.xml"], log)
    assert system is not None
    assert system.policy is not None
    policy = read_policy(system.policy, system, log)
    return policy, log


def read(folder: Path, trees: str) -> tuple[Policy | None, list[str]]:
    """The policy of ``trees`` (a node, or several ``<BehaviorTree>``), and what is said of its errors."""
    if not trees.startswith("<BehaviorTree"):
        trees = f'<BehaviorTree ID="Main">{trees}</BehaviorTree>'
    trees = re.sub(r"<([SFR])(?=[ /])", r'<Action ID="\1" service_name="/\1/tick"', trees)
    policy, log = with_skills(folder, trees, ANSWERS)
    errors = [found for found in log.diagnostics if found.severity is Severity.ERROR]
    assert all(found.position.line for found in errors), errors  # with a place
    return policy, [
        (f"<{found.element}>: " if found.element else "")
        + found.message
        + (f"; {found.hint}" if found.hint else "")
        for found in errors
    ]


def statuses(folder: Path, trees: str, ticks: int) -> list[str]:
    """What ``ticks`` ticks of ``trees`` give."""
    policy, said = read(folder, trees)
    assert policy is not None, said
    transport = Skills({f"/{name}/tick": answer for name, answer in ANSWERS.items()})
    runner = PolicyRunner(transport, policy)
    return [runner.tick().status for _ in range(ticks)]
