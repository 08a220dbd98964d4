"""What was found as JUnit XML, which continuous integration shows: a suite a recording, a case a machine."""

from __future__ import annotations

import re
from collections.abc import Sequence
from xml.etree import ElementTree as Tree

from moon.monitor.report import verdict_lines
from moon.monitor.status import UNSEEN, MachineStatus
from moon.offline.result import CheckResult
from moon.verdict import Outcome

_FORBIDDEN = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters that XML 1.0 does not have (2.2)."""


def junit(results: Sequence[CheckResult], failures: Sequence[tuple[str, str]]) -> bytes:
    """The document.

    Args:
        results: of the recordings that were checked.
        failures: paths of those that could not be, and why.
    """
    suites = Tree.Element("testsuites", name="moon check")
    for result in results:
        suites.append(_suite(result))
    for path, why in failures:
        suite = Tree.SubElement(suites, "testsuite", name=_text(path), tests="1", errors="1")
        case = Tree.SubElement(suite, "testcase", classname=_text(path), name="recording")
        Tree.SubElement(case, "error", message=_text(why))
    Tree.indent(suites)
    made: bytes = Tree.tostring(suites, encoding="utf-8", xml_declaration=True)
    return made + b"\n"


def _suite(result: CheckResult) -> Tree.Element:
    machines = result.machines
    suite = Tree.Element(
        "testsuite",
        name=_text(result.recording.path),
        tests=str(len(machines)),
        failures=str(sum(machine.violations > 0 for machine in machines)),
        errors="0",
        skipped=str(sum(_is_open(machine) for machine in machines)),
        time=f"{result.seconds:.3f}",
    )
    for machine in machines:
        case = Tree.SubElement(
            suite,
            "testcase",
            classname=_text(f"{result.system or 'moon'}.{machine.kind}"),
            name=_text(machine.machine),
        )
        if machine.violations:
            _fail(case, result, machine)
        elif _is_open(machine):
            Tree.SubElement(case, "skipped", message=_text(f"{machine.verdict}: {machine.last}"))
    said = (*result.recording.faults, *result.recording.limits, *result.problems)
    if said:
        Tree.SubElement(suite, "system-err").text = _text("\n".join(said))
    return suite


def _is_open(machine: MachineStatus) -> bool:
    """Whether nothing is known of it in the end."""
    return not machine.violations and machine.verdict in (UNSEEN, str(Outcome.INCONCLUSIVE))


def _fail(case: Tree.Element, result: CheckResult, machine: MachineStatus) -> None:
    found = [
        said.verdict
        for said in result.violated
        if said.verdict.node == machine.machine and said.verdict.kind == machine.kind
    ]
    message = found[0].reason if found else machine.last
    failure = Tree.SubElement(case, "failure", message=_text(message), type="violated")
    failure.text = _text("\n".join(line for verdict in found for line in verdict_lines(verdict)))


def _text(text: str) -> str:
    return _FORBIDDEN.sub("�", text)
