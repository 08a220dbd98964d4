"""A report with one text in every slot that a model, a recording, a file's name or the wire can fill."""

from __future__ import annotations

import json
from pathlib import Path
from xml.sax.saxutils import quoteattr

from m2c.model import DiagnosticLog, load
from m2c.printable import printable
from moon.feed.counts import Counts
from moon.monitor.status import PROPERTY, MachineStatus
from moon.offline.result import Band, CheckResult, RecordingFacts, Timeline
from moon.recording.entries import ReportedVerdict
from moon.report import write_report
from moon.verdict import Evidence, Explanation, Outcome, Verdict
from tests.report.samples import START, START_S

SCRIPT = "window.__pwned=1;alert(1)"
TEXTS = (
    f"</script><script>{SCRIPT}</script><!--<script>\"'",
    f'"><img src=x onerror="{SCRIPT}"><a href="javascript:{SCRIPT}">',
    f"' autofocus onfocus='{SCRIPT}' style='background:url(//x.invalid)",
    f"</title></style></text></svg><svg onload={SCRIPT}>]]>&lt;b&#62;",
    f"{{{{ 7*7 }}}}{{% for x in y %}}{{# ${{{SCRIPT}}} `",
    "\x1b[2J\u202e\u2066\u2028\u200bx\x00\ud800",
)

MODEL = """<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" name={0} initial={0}>
<ros_topic_publisher name={0} topic={0} type="std_msgs/String"/>
<state id={0}><onentry><log label={0} expr="1"/></onentry>
<transition event={0} target={0}><log label={0}/></transition></state></scxml>"""


def harmless(text: str) -> str:
    """Text of the same shape as ``text``: as long where it is shown, with blanks in the same places."""
    return "".join(c if c == " " else "x" for c in printable(text))


def write_hostile_report(text: str, folder: Path) -> Path:
    """Write the page, and what it is made of, into ``folder``."""
    folder.mkdir()
    in_xml = quoteattr(printable(text))
    model = folder / "model.scxml"
    model.write_text(MODEL.format(in_xml), encoding="utf-8")
    name = text.replace("/", "_").replace("\0", "_").replace("\ud800", "_")
    log = folder / f"{name}.jsonl"
    wire = {"topic": f"/{text}", "time": START_S + 1, text: [text, {text: text}]}
    call = {"service": f"/{text}/call", "time": START_S + 2, "request": {text: text}}
    log.write_text("".join(json.dumps(entry) + "\n" for entry in (wire, call)), encoding="utf-8")
    page = folder / "report.html"
    write_report(_result(text, log, model), page)
    return page


def _result(text: str, log: Path, model: Path) -> CheckResult:
    found = DiagnosticLog()
    system = load([model], found)
    assert system is not None, found.diagnostics
    (machine,) = system.nodes
    place = str(machine.states[0].transitions[0].position)
    said = (
        _violation(machine.name, text, place, "model"),
        _violation(f"2{text}", text, text, PROPERTY),
        ReportedVerdict(
            START, Verdict(f"3{text}", f"3{text}", Outcome.VIOLATED, START, text, None)
        ),
    )
    machines = tuple(
        MachineStatus(text, "violated", (text, text), 5, 4, 1, 0, 1.0, text, kind)
        for kind in ("model", PROPERTY)
    )
    bands = (Band(START, START + 10**9, (text,), "violated"),)
    timelines = tuple(Timeline(text, one.kind, bands, merged=3) for one in machines)
    facts = RecordingFacts(
        str(log), text, 2, START, START + 10**9, False, faults=(text,), limits=(f"2{text}",)
    )
    return CheckResult(
        facts, (str(model),), text, (text,), (), said, machines, timelines, Counts(received=2),
        (f"3{text}",), seconds=0.4,
    )  # fmt: skip


def _violation(name: str, text: str, place: str, kind: str) -> ReportedVerdict:
    why = Explanation((text,), text, (text,), (Evidence(START, text),), (place, text))
    verdict = Verdict(name, name, Outcome.VIOLATED, START, text, why, kind)
    return ReportedVerdict(START + 10**8, verdict)
