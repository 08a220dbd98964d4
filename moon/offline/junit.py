"""What was found as JUnit XML, which continuous integration shows: a suite a recording, a case a machine."""

from __future__ import annotations

from collections.abc import Sequence

from lxml import etree

from m2c.model.xml_writing import below, element
from moon.monitor.report import verdict_lines
from moon.monitor.status import MachineStatus
from moon.offline.result import CheckResult


def junit(results: Sequence[CheckResult], failures: Sequence[tuple[str, str]]) -> bytes:
    """The document.

    Args:
        results: of the recordings that were checked.
        failures: paths of those that could not be, and why.
    """
    suites = element("testsuites", {"name": "moon check"})
    for result in results:
        suites.append(_suite(result))
    for path, why in failures:
        suite = below(suites, "testsuite", {"name": path, "tests": "1", "errors": "1"})
        case = below(suite, "testcase", {"classname": path, "name": "recording"})
        below(case, "error", {"message": why})
    return etree.tostring(suites, encoding="utf-8", xml_declaration=True, pretty_print=True)


def _suite(result: CheckResult) -> etree._Element:
    machines = result.machines
    suite = element(
        "testsuite",
        {
            "name": result.recording.path,
            "tests": str(len(machines)),
            "failures": str(sum(machine.violations > 0 for machine in machines)),
            "errors": "0",
            "skipped": str(len(result.undecided)),
            "time": f"{result.seconds:.3f}",
        },
    )
    for machine in machines:
        classname = f"{result.system or 'moon'}.{machine.kind}"
        case = below(suite, "testcase", {"classname": classname, "name": machine.machine})
        if machine.violations:
            _fail(case, result, machine)
        elif machine in result.undecided:
            below(case, "skipped", {"message": f"{machine.verdict}: {machine.last}"})
    sentences = (*result.recording.faults, *result.recording.limits, *result.problems)
    if sentences:
        below(suite, "system-err", {}, "\n".join(sentences))
    return suite


def _fail(case: etree._Element, result: CheckResult, machine: MachineStatus) -> None:
    found = [
        reported.verdict
        for reported in result.violated
        if reported.verdict.node == machine.machine and reported.verdict.kind == machine.kind
    ]
    message = found[0].reason if found else machine.last
    lines = "\n".join(line for verdict in found for line in verdict_lines(verdict))
    below(case, "failure", {"message": message, "type": "violated"}, lines)
