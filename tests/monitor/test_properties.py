"""Properties in a monitor: the same table, verdicts and exit codes; deadlines; what was missed."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import pytest
from click.testing import CliRunner

from moon.cli import main as moon
from moon.judge import Intake
from moon.monitor.departures import Departures
from moon.monitor.properties import LOOK_NS, PropertyWatch
from moon.monitor.report import closing, table, verdict_lines
from moon.monitor.turns import BEHIND_NS
from moon.properties.files import load_properties
from moon.sinks.topic import message_of
from moon.verdict import Outcome
from tests.monitor.hand_driven import MS, START, HandDriven, S, write_models
from transports.interface import Answer, Observation, ObservationKind

LATENCY = 200 * MS
FILE = """\
ports:
  battery: {topic: /battery, field: data}
  asked: {service: /Level/tick, on: request}
  answered: {service: /Level/tick, on: response}
  wrong: {service: /Level/tick, on: response, when: data.status == 1}
properties:
  - {id: answers, pattern: response, request: asked, response: answered, within: 1 s, text: No answer.}
  - {id: high, pattern: absence, of: wrong, before: battery < 30, severity: critical}
"""


TAKEN = ("/Level/tick", ObservationKind.MESSAGE_TAKEN, "t/srv/Tick_Response", None, "Level")
ANSWER = (
    "/Level/tick",
    ObservationKind.RESPONSE_SENT,
    "t/srv/Tick_Response",
    {"status": 0},
    "Level",
)
ASKED = ("/Level/tick", ObservationKind.REQUEST_SENT, "t/srv/Tick_Request", {}, "policy")
ELSEWHERE = ("/other", ObservationKind.MESSAGE, "t/srv/Tick_Response", {"status": 0}, "Level")


class Watched(HandDriven):
    """The hand-driven watch, with properties."""

    def __init__(
        self,
        folder: Path,
        text: str = FILE,
        monitored: bool = True,
        awaited: Sequence[str] = (),
    ) -> None:
        self.numbers = False
        self.orders: dict[str, int] = {}
        path = folder / "p.yaml"
        path.write_text(text)
        properties = load_properties(path)
        departures = Departures(properties, awaited=awaited)
        self.properties = PropertyWatch(properties, LATENCY, departures)
        super().__init__(folder, self.properties, monitored)

    def answer(self, late_by: int) -> None:
        """Level's answer is heard so long after it was given."""
        self.hear(
            "/Level/tick",
            ObservationKind.RESPONSE_SENT,
            "t/srv/Tick_Response",
            {"status": 0},
            "Level",
            stamp_ns=self.now - late_by,
            call=1,
        )

    def hear(self, channel, kind, type_name, data, source, **changes) -> None:
        """In a system whose nodes number all that they report, with the next number of its source."""
        if self.numbers:
            self.orders[source] = self.orders.get(source, -1) + 1
            changes.setdefault("order", self.orders[source])
        super().hear(channel, kind, type_name, data, source, **changes)

    def reply(self, *names: str, missing: int = 0) -> None:
        """Nodes that were asked answer that they have reported all until now, ``missing`` more than it was."""
        for name in names:
            number = self.orders.get(name, -1) + 1 + missing
            self.asked.pop(name)(Answer(self.now, number))

    def of(self, name: str) -> list[str]:
        return [str(verdict.outcome) for verdict in self.verdicts if verdict.node == name]

    def standing(self) -> dict[str, str]:
        return {status.machine: status.verdict for status in self.watch.statuses()}


@pytest.fixture
def watched(tmp_path) -> Watched:
    return Watched(tmp_path)


def test_properties_stand_in_the_table_after_the_machines(watched) -> None:
    watched.node("Level", True)
    watched.message(90)
    watched.tick(1, 0)
    watched.pass_time(300)
    assert watched.standing() == {
        "Level": "conforming",
        "answers": "conforming",
        "high": "conforming",
    }
    rows = table(watched.watch.statuses())
    assert re.match(r"answers +conforming +guarantee +4 ", rows[2])
    assert (
        "1 machine: 1 conforming; 2 properties: 2 conforming; "
        in closing(watched.watch.summary())[0]
    )


def test_a_misspelt_channel_is_told_with_what_was_meant(tmp_path) -> None:
    text = FILE.replace("/Level/tick", "/Levl/tick").replace("/battery", "/batery")
    watched = Watched(tmp_path, text, monitored=False)
    watched.node("Level", True)
    watched.tick(1, 0)
    watched.hear("/batteries", ObservationKind.MESSAGE, "t/msg/Count", {"data": 9}, "driver")
    watched.pass_time(300)
    assert watched.watch.silent() == [
        "nothing was received on /Levl/tick; did you mean /Level/tick?",
        "nothing was received on /batery; did you mean /batteries?",
    ]


def test_of_a_channel_that_is_there_nothing_is_told(watched) -> None:
    watched.pass_time(300)
    assert watched.watch.silent() == []  # models name it
    watched.message(90)
    watched.tick(1, 0)
    assert watched.watch.silent() == []


def test_a_response_that_never_comes_is_reported_at_its_deadline_by_the_timer(watched) -> None:
    watched.message(90)
    watched.tick(1)
    asked = watched.now - MS
    watched.pass_time(1190)
    assert watched.of("answers") == ["conforming"]
    watched.pass_time(30)
    (found,) = [item for item in watched.verdicts if item.kind == "property" and item.explanation]
    assert found.outcome is Outcome.VIOLATED
    assert found.stamp_ns - asked in range(S - MS, S + MS)
    assert watched.now - found.stamp_ns <= 230 * MS
    assert found.reason == "error: No answer."
    watched.pass_time(1000)
    assert watched.of("answers") == ["conforming", "violated"]
    assert watched.watch.violations == 1


@pytest.mark.parametrize(
    ("pattern", "why"),
    [
        ("response, request: asked, response: wrong", "not (wrong) for 1 s"),
        ("response, request: {rises: battery < 30}, response: wrong", "not (wrong) for 1 s"),
        ("recurrence, of: battery > 30", "not (battery > 30) for 1 s"),
        ("existence, of: wrong, after: battery < 30", "not (wrong) for 1 s"),
        ("universality, of: battery > 30, after: battery < 30, no_sooner: 1 s", "for 1 s"),
    ],
)
def test_what_is_false_by_lapse_of_time_has_the_time_of_its_deadline(tmp_path, pattern, why):
    """Not that of the last message, nor that at which it was said."""
    within = "" if "no_sooner" in pattern else ", within: 1 s"
    ports = FILE.split("  - {", maxsplit=1)[0]
    watched = Watched(tmp_path, f"{ports}  - {{id: P, pattern: {pattern}{within}}}\n")
    watched.message(90)
    watched.pass_time(500)
    watched.message(29)
    watched.tick(1, 0)
    last_ns = watched.now
    watched.pass_time(2000)
    violated = [item for item in watched.verdicts if item.node == "P" and item.explanation]
    found = next(item for item in violated if item.stamp_ns > last_ns)
    assert found.stamp_ns - last_ns in range(S - 3 * MS, S + MS)
    assert found.explanation.observed.endswith(why)
    assert found.explanation.evidence[-1].stamp_ns <= last_ns


def test_what_was_before_a_rise_lasted_until_then(tmp_path):
    ports = FILE.split("  - {", maxsplit=1)[0]
    watched = Watched(
        tmp_path, f"{ports}  - {{id: P, pattern: absence, of: {{rises: battery < 30}}}}\n"
    )
    watched.message(90)
    watched.pass_time(1000)
    watched.message(29, stamp_ns=watched.now)  # 1 s after the last one
    watched.pass_time(1000)
    (found,) = [item for item in watched.verdicts if item.node == "P" and item.explanation]
    assert [item.text.split(": ")[0] for item in found.explanation.evidence] == [
        *("not (battery < 30) for 1 s", "battery < 30"),
    ]


def test_as_long_as_nothing_was_heard_a_deadline_waits_for_the_latency_bound(tmp_path) -> None:
    text = FILE.split("properties:", maxsplit=1)[0] + (
        "properties: [{id: soon, pattern: existence, of: asked, within: 1 s}]\n"
    )
    watched = Watched(tmp_path, text)
    watched.pass_time(1190)
    assert "violated" not in watched.of("soon")
    watched.pass_time(20)
    assert watched.of("soon")[-1] == "violated"
    watched.pass_time(1000)
    assert watched.properties.violations == 1


def numbered_tick(watched: Watched) -> None:
    """The policy's first tick, of which nothing is answered, in a system of nodes that number."""
    watched.numbers = True
    watched.node("Level", True)
    watched.node("policy", True)
    watched.message(90)
    watched.tick(1)


def test_nodes_are_asked_when_a_deadline_has_passed_and_what_they_say_makes_it_certain(watched):
    numbered_tick(watched)
    watched.pass_time(1000 + LOOK_NS // MS - 2)
    watched.asked.clear()  # by the model's oracle
    watched.pass_time(15)
    assert set(watched.asked) == {"Level", "policy", "Battery"}
    assert watched.of("answers") == ["conforming"]
    watched.reply("Level", "policy")
    assert watched.of("answers") == ["conforming"]
    watched.reply("Battery")
    assert watched.of("answers") == ["conforming", "violated"]
    assert watched.now - watched.verdicts[-1].stamp_ns <= 30 * MS
    watched.pass_time(1000)
    assert watched.of("answers") == ["conforming", "violated"]


def test_who_has_reported_more_than_was_received_is_waited_for(watched) -> None:
    numbered_tick(watched)
    watched.pass_time(1025)
    watched.reply("policy", "Battery")
    watched.reply("Level", missing=1)
    assert watched.of("answers") == ["conforming"]
    watched.answer(late_by=100 * MS)
    watched.pass_time(1000)
    assert watched.of("answers") == ["conforming"]


@pytest.mark.parametrize("is_received", [True, False])
def test_a_response_that_its_client_received_was_sent_whether_its_report_is_lost_or_not(
    tmp_path, is_received: bool
) -> None:
    """Nothing else comes of the server, whose next number would show the loss (ROS 2)."""
    watched = Watched(tmp_path, monitored=False)
    watched.node("Level", True)
    watched.node("policy", True)
    watched.tick(1, 0)
    watched.pass_time(1500)
    watched.tick(2)
    if is_received:
        received = ObservationKind.RESPONSE_RECEIVED
        watched.hear(*(ANSWER[0], received, *ANSWER[2:4], "policy"), call=2)
    watched.pass_time(2000)
    said = watched.of("answers")[-1]
    assert said == ("inconclusive" if is_received else "violated")


def test_properties_begin_with_listening_where_a_channel_is_not_received_at_all(tmp_path) -> None:
    """Of that channel everything may have happened, since then: the time of another property runs from then."""
    text = """\
ports:
  gone: {topic: /gone}
  answered: {service: /Level/tick, on: response}
properties:
  - {id: never, pattern: absence, of: gone}
  - {id: soon, pattern: existence, of: answered, within: 2 s}
"""
    watched = Watched(tmp_path, text, monitored=False)
    watched.properties.miss(["/gone"])
    watched.properties.start(watched.now)
    watched.pass_time(500)
    assert "violated" not in watched.of("soon")
    watched.pass_time(3000)
    assert watched.of("soon")[-1] == "violated"


def test_who_was_heard_and_does_not_answer_is_judged_by_the_latency_bound(watched) -> None:
    numbered_tick(watched)
    watched.pass_time(1025)
    watched.reply("policy", "Battery")
    watched.pass_time(160)
    assert watched.of("answers") == ["conforming"]
    watched.pass_time(30)
    assert watched.of("answers") == ["conforming", "violated"]


@pytest.mark.parametrize("unheard_ms", [100, 1200])
def test_who_is_gone_after_it_was_not_heard_for_long_may_be_out_of_reach(watched, unheard_ms):
    watched.numbers = True
    began_ns = watched.now
    watched.node("Level", True)
    watched.node("policy", True)
    watched.reply("Level")
    watched.message(90)
    watched.pass_time(unheard_ms)
    watched.node("Level", False)
    watched.hear(*ASKED, call=1, client="policy")
    watched.pass_time(2000)
    is_out_of_reach = unheard_ms > 1000
    assert (watched.of("answers")[-1] == "violated") is not is_out_of_reach
    if is_out_of_reach:
        watched.orders["Level"] = 3  # it has answered meanwhile
        watched.node("Level", True, since=began_ns)
        watched.hear(*ELSEWHERE)
        watched.pass_time(1000)
        assert "violated" not in watched.of("answers")


def test_who_comes_up_is_asked_before_anything_is_presumed_of_properties(tmp_path) -> None:
    """Whether it answers is to be known before it is cut off, with no model of it, too."""
    watched = Watched(tmp_path, monitored=False)
    watched.numbers = True
    watched.node("Level", True)
    watched.node("policy", True)
    watched.pass_time(100)
    watched.reply("Level")
    watched.message(90)
    watched.pass_time(1200)
    watched.node("Level", False)
    watched.hear(*ASKED, call=1, client="policy")
    watched.pass_time(2000)
    assert "violated" not in watched.of("answers")


def test_what_was_lost_is_known_before_what_comes_later_counts(watched) -> None:
    """It may have been the answer, though no later number of that channel has come."""
    numbered_tick(watched)
    watched.orders["Level"] += 1
    watched.hear("/elsewhere", ObservationKind.MESSAGE, "t/msg/Level", {"data": 1}, "Level")
    watched.pass_time(1500)
    assert watched.of("answers") == ["conforming", "inconclusive"]


def test_what_an_observation_breaks_is_said_when_all_have_answered(watched) -> None:
    numbered_tick(watched)
    watched.pass_time(300)
    watched.asked.clear()
    watched.hear(
        *("/Level/tick", ObservationKind.RESPONSE_SENT, "t/srv/Tick_Response", {"status": 1}),
        *("Level",),
        call=1,
    )
    watched.pass_time(25)
    assert "violated" not in watched.of("high")
    watched.reply("policy", "Battery")
    if "Level" in watched.asked:
        watched.reply("Level")
    assert watched.of("high")[-1] == "violated"


def test_what_is_unknown_is_not_looked_at_all_the_time(watched) -> None:
    watched.message(20)
    watched.properties.lose_all(watched.now - 1, watched.now + 1)
    for _ in range(70):  # until the loss is forgotten, but not what it left unknown
        watched.hear("/elsewhere", ObservationKind.MESSAGE, "t/msg/Level", {"data": 1}, "Other")
        watched.pass_time(1000)
    before = watched.properties.turns
    watched.pass_time(1000)
    assert watched.properties.turns - before <= 1


def test_what_comes_to_count_for_good_does_so_behind_the_tick_that_has_begun_meanwhile(
    watched,
) -> None:
    watched.message(90)
    heard_ns = watched.now
    watched.pass_time(60)
    properties = watched.properties
    assert heard_ns < properties.next_ns <= heard_ns + 200 * MS
    assert properties.due_ns == properties.next_ns + BEHIND_NS
    watched.pass_time(300)
    assert properties.due_ns == properties.next_ns  # nothing was heard meanwhile
    properties.lose_all(watched.now, watched.now + MS)
    assert properties.due_ns == 0


def test_what_comes_late_is_in_time_within_the_latency_bound(watched) -> None:
    watched.message(90)
    watched.tick(1)
    watched.pass_time(1150)
    watched.answer(late_by=170 * MS)
    watched.pass_time(1000)
    assert "violated" not in watched.of("answers")


def test_a_monitor_that_is_held_up_itself_blames_nobody(watched) -> None:
    watched.message(90)
    watched.tick(1)
    watched.pass_time(800)
    watched.jump(110 * MS)
    watched.pass_time(150)
    assert "violated" not in watched.of("answers")
    watched.answer(late_by=80 * MS)
    watched.pass_time(1000)
    assert "violated" not in watched.of("answers")


def test_a_violation_says_what_was_meant_what_was_seen_and_where_it_is_written(watched) -> None:
    watched.message(90)
    watched.tick(1, 1)
    watched.pass_time(300)
    (found,) = [item for item in watched.verdicts if item.outcome is Outcome.VIOLATED]
    assert (found.machine, found.node, found.kind) == ("high", "high", "property")
    lines = verdict_lines(found)
    assert lines[0].endswith(
        "high  VIOLATED  critical: Before the first `battery < 30`, `wrong` never happens."
    )
    text = "\n".join(lines)
    assert "wrong: response sent on /Level/tick of Level {status: 1}" in text
    assert "not (battery < 30)" in text
    assert "(and more before)" not in text
    assert re.search(r"written +\S*p\.yaml:8:", text)
    assert message_of(found).outcome == "violated"


def test_properties_alone_need_no_models(tmp_path) -> None:
    watched = Watched(tmp_path, monitored=False)
    watched.message(90)
    watched.tick(1, 1)
    watched.pass_time(300)
    assert watched.standing() == {"answers": "conforming", "high": "violated"}
    assert watched.watch.summary().counts.unknown == {}
    (line,) = closing(watched.watch.summary())
    assert line.endswith("2 properties: 1 conforming, 1 violated; received 5 observations")


def test_a_lost_response_makes_no_violation(watched) -> None:
    watched.message(90)
    watched.tick(1, 0)
    watched.pass_time(2000)
    for kind, source in (
        (ObservationKind.REQUEST_SENT, "policy"),
        (ObservationKind.REQUEST_RECEIVED, "Level"),
    ):
        watched.hear("/Level/tick", kind, "t/srv/Tick_Request", {}, source, call=2)
    # the answer is missing here: when it is due, the number has moved on by one more than it should
    watched.pass_time(1010)
    watched._numbers["Level", "/Level/tick", False] += 1
    watched.tick(3, 0)
    watched.pass_time(1000)
    assert "violated" not in watched.of("answers")
    assert "inconclusive" in watched.of("answers")


def test_what_came_too_late_makes_whatever_depends_on_it_inconclusive(watched) -> None:
    watched.message(90)
    watched.tick(1)
    watched.pass_time(900)
    watched.hear(
        "/Level/tick",
        ObservationKind.RESPONSE_SENT,
        "t/srv/Tick_Response",
        {"status": 0},
        "Level",
        stamp_ns=watched.now - 850 * MS,
        call=1,
    )
    watched.pass_time(2000)
    assert "violated" not in watched.of("answers")


def test_after_a_loss_what_comes_even_later_is_counted_and_judges_nothing(tmp_path) -> None:
    watch = Watched(tmp_path).properties
    watch.advance(START + S)
    watch.lose("/Level/tick", START + S, START + S + 100 * MS)
    watch.advance(START + 2 * S)
    late = Observation(
        stamp_ns=START + S + 50 * MS,
        received_ns=START + 2 * S,
        channel="/Level/tick",
        kind=ObservationKind.RESPONSE_SENT,
        type_name="t/srv/Tick_Response",
        data={"status": 1},
        source="Level",
    )
    watch.observe(Intake(late, START + 2 * S))
    assert watch.late == 1
    assert all(said.outcome is not Outcome.VIOLATED for said in watch.advance(START + 4 * S))


def test_a_clock_that_is_set_back_begins_properties_anew(watched) -> None:
    watched.message(90)
    watched.pass_time(300)
    watched.jump(-5 * S)
    assert watched.of("high")[-1] == "inconclusive"
    watched.tick(1)
    watched.pass_time(1400)
    assert watched.of("answers") == ["conforming", "inconclusive", "violated"]


def test_a_monitor_that_stood_still_blames_no_property_for_what_it_missed(watched) -> None:
    watched.message(90)
    watched.tick(1)
    watched.jump(3 * S)
    watched.pass_time(2000)
    assert "violated" not in watched.of("answers")


def test_time_begins_when_listening_begins(tmp_path) -> None:
    text = FILE.split("properties:", maxsplit=1)[0] + (
        "properties: [{id: soon, pattern: existence, of: asked, within: 1 s}]\n"
    )
    watched = Watched(tmp_path, text)
    watched.pass_time(1500)
    (found,) = [item for item in watched.verdicts if item.outcome is Outcome.VIOLATED]
    assert abs(found.stamp_ns - START - S) <= MS


def of_the_beginning(folder: Path, connection: type[Watched] = Watched) -> Watched:
    return connection(
        folder,
        "ports: {level: {topic: /battery, field: data, initial: 0}, asked: {service: /Level/tick, on: request}}\n"
        "properties: [{id: full, pattern: universality, of: level == 100, before: asked}]\n",
    )


def test_who_was_there_before_may_have_changed_what_an_initial_value_breaks(tmp_path) -> None:
    watched = of_the_beginning(tmp_path)
    watched.node("Level", True, since=watched.now - 10 * S)
    watched.pass_time(3000)
    assert "violated" not in watched.of("full")


@pytest.mark.parametrize(("order", "expected"), [(0, ["violated"]), (5, [])])
def test_who_has_done_something_before_it_is_known_to_be_there_did_what_is_not_known(
    tmp_path, order: int, expected: list[str]
) -> None:
    """Where it is found late, its first report comes before anybody says that it is there."""
    watched = Watched(
        tmp_path,
        "ports: {level: {topic: /battery, field: data}}\n"
        "properties: [{id: first, pattern: precedence, cause: level > 50, effect: level < 50}]\n",
    )
    watched.pass_time(500)
    watched.message(40, order=order)
    watched.pass_time(3000)
    assert [said for said in watched.of("first") if said == "violated"] == expected


def test_who_was_out_of_reach_and_is_back_takes_nothing_back(tmp_path) -> None:
    watched = Watched(
        tmp_path,
        "ports: {level: {topic: /battery, field: data}}\n"
        "properties: [{id: full, pattern: universality, of: level > 50}]\n",
    )
    watched.numbers = True
    since = watched.now - 10 * S
    watched.node("Battery", True, since=since)
    watched.pass_time(500)
    watched.message(90)
    watched.pass_time(500)
    watched.message(40)
    watched.pass_time(1000)
    watched.message(40)
    watched.pass_time(1000)
    assert watched.of("full")[-1] == "violated"
    watched.node("Battery", False)
    watched.pass_time(3000)
    watched.node("Battery", True, since=since)
    watched.pass_time(1000)
    assert watched.of("full")[-1] == "violated"


def test_of_a_system_that_starts_later_an_initial_value_is_judged(tmp_path) -> None:
    watched = of_the_beginning(tmp_path)
    watched.node("Level", True)
    watched.reply("Level")
    watched.pass_time(3000)
    assert watched.of("full") == ["violated"]


def test_who_is_never_found_is_not_there_or_cut_off_for_as_long_as_a_lease(tmp_path) -> None:
    class Finding(Watched):
        finds_nodes = True

    watched = of_the_beginning(tmp_path, Finding)
    watched.pass_time(19_000)
    assert "violated" not in watched.of("full")
    watched.pass_time(2000)
    assert watched.of("full")[-1] == "violated"


def _said(*arguments: object) -> tuple[int, str]:
    result = CliRunner().invoke(moon, ["monitor", *map(str, arguments)])
    return result.exit_code, " ".join(result.stderr.split())


def test_a_property_file_with_an_error_is_exit_code_2_with_its_place(tmp_path) -> None:
    path = tmp_path / "p.yaml"
    path.write_text(FILE.replace("pattern: absence", "pattern: abscence"))
    code, text = _said("--properties", path)
    assert code == 2
    assert re.search(r"p\.yaml:8:\d+: error: .*`abscence` is not a pattern", text)


def test_neither_models_nor_properties_is_exit_code_2() -> None:
    assert _said() == (2, _said()[1])
    assert "Missing argument 'MODEL...|SYSTEM' (or --properties FILE)" in _said()[1]


def test_nodes_cannot_be_chosen_without_models(tmp_path) -> None:
    (tmp_path / "p.yaml").write_text(FILE)
    code, text = _said("--properties", tmp_path / "p.yaml", "--only", "Level")
    assert code == 2
    assert "there are none" in text


def test_a_channel_that_no_model_names_is_an_error_with_the_one_that_was_meant(tmp_path) -> None:
    model = write_models(tmp_path)
    path = tmp_path / "p.yaml"
    path.write_text(FILE.replace("/battery", "/batery"))
    code, text = _said(model, "--properties", path, "--endpoint", "nowhere")
    assert code == 2
    assert "p.yaml:2:20: error: <ports>: no model of Level names the topic /batery;" in text
    assert "did you mean /battery?" in text


def test_of_a_foreign_channel_with_a_name_like_one_of_the_models_it_warns(tmp_path) -> None:
    model = write_models(tmp_path)
    path = tmp_path / "p.yaml"
    path.write_text(FILE.replace("/battery,", "/battery_2, type: std_msgs/msg/Int32,"))
    _, text = _said(model, "--properties", path, "--endpoint", "nowhere")
    assert "p.yaml:2:20: warning: <ports>: no model of Level names the topic /battery_2;" in text
    assert "error: <ports>" not in text


def test_an_answer_that_comes_later_than_the_latency_bound_shows_a_violation_was_none(watched):
    watched.message(90)
    watched.tick(1)
    watched.pass_time(1400)
    assert watched.of("answers")[-1] == "violated"
    assert watched.properties.violations == 1
    said = watched.verdicts[-1]
    withdrawn = []
    watched.properties.withdrawn = lambda name, since_ns: withdrawn.append((name, since_ns))
    late = Observation(
        stamp_ns=watched.now - 500 * MS,
        received_ns=watched.now,
        channel="/Level/tick",
        kind=ObservationKind.RESPONSE_SENT,
        type_name="t/srv/Tick_Response",
        data={"status": 0},
        source="Level",
    )
    watched.properties.observe(Intake(late, watched.now))
    watched.pass_time(1000)
    assert watched.properties.late == 1
    assert watched.of("answers")[-1] == "inconclusive"
    assert withdrawn == [("answers", said.stamp_ns)]
    assert watched.properties.violations == 0
    assert any(
        verdict.reason == "the violation is withdrawn: messages on /Level/tick were missed"
        for verdict in watched.verdicts
    )
    assert watched.standing()["answers"] == "inconclusive"


def test_a_violation_from_before_a_loss_stands(watched) -> None:
    watched.message(90)
    watched.tick(1, 1)
    watched.pass_time(300)
    assert watched.properties.violations == 1
    watched.properties.lose("/Level/tick", watched.now - 250 * MS, watched.now)
    watched.pass_time(1000)
    assert watched.properties.violations == 1
    assert watched.standing()["high"] == "violated"


@pytest.mark.parametrize("later", [0, 1, 2, 5])
def test_a_gap_in_the_numbers_is_a_loss_however_close_the_stamps_are(tmp_path, later) -> None:
    watched = Watched(tmp_path, FILE.replace("before: battery < 30, ", ""))
    watched.pass_time(1000)
    sent_ns = watched.now
    for sequence, stamp_ns in ((5, sent_ns), (7, sent_ns + later)):  # 6 may have been wrong
        watched.hear(
            *("/Level/tick", ObservationKind.RESPONSE_SENT, "t/srv/Tick_Response", {"status": 0}),
            *("Level",),
            stamp_ns=stamp_ns,
            sequence=sequence,
        )
    watched.pass_time(1000)
    assert watched.of("high")[-1] == "inconclusive"


@pytest.mark.parametrize("kind", [TAKEN, ANSWER])
def test_a_violation_between_two_losses_stands(tmp_path, kind) -> None:
    """The numbers of one channel show that something was lost, those of its node when."""
    watched = Watched(tmp_path, monitored=False)
    watched.message(90)
    watched.hear(*kind, sequence=0, order=0)
    watched.pass_time(300)
    watched.hear(*ELSEWHERE, order=2)  # something is missing before it
    watched.pass_time(300)
    watched.hear(*ASKED, call=1, client="policy")
    watched.pass_time(1100)
    watched.hear(*ELSEWHERE, order=3)
    watched.pass_time(300)
    assert watched.of("answers")[-1] == "violated"
    watched.hear(*ELSEWHERE, order=5)
    watched.hear(*kind, sequence=3, order=6)
    watched.pass_time(1000)
    assert watched.properties.violations == 1
    assert not any("withdrawn" in verdict.reason for verdict in watched.verdicts)


def test_a_violation_from_before_the_clock_was_set_back_is_not_withdrawn_by_what_is_lost_later(
    watched,
):
    watched.message(90)
    watched.tick(1)
    watched.pass_time(1400)
    assert watched.properties.violations == 1
    withdrawn = []
    watched.properties.withdrawn = lambda name, since_ns: withdrawn.append(name)
    began_ns = watched.now - 5_000 * MS
    watched.properties.begin_anew(began_ns, "the clock was set back by 5.0 s")
    watched.properties.lose("/Level/tick", began_ns, began_ns + 100 * MS)
    watched.properties.advance(began_ns + 1_000 * MS)
    assert not withdrawn
    assert watched.properties.violations == 1


def test_a_violation_from_before_the_clock_was_set_forward_stands(watched) -> None:
    numbered_tick(watched)
    watched.pass_time(1000 + LOOK_NS // MS + 13)
    watched.reply("Level", "policy", "Battery")
    assert watched.of("answers")[-1] == "violated"
    withdrawn = []
    watched.properties.withdrawn = lambda name, since_ns: withdrawn.append(name)
    watched.set_forward_ns += 300 * MS
    watched.jump(300 * MS)
    watched.pass_time(1000)
    assert not withdrawn
    assert watched.properties.violations == 1
    assert watched.of("answers")[-1] == "inconclusive"


@pytest.mark.parametrize("step_ms", [-3_600_000, -300, -20, 20, 300, 3_600_000])
def test_what_was_asked_before_the_clock_was_set_may_be_answered_after_it(tmp_path, step_ms):
    text = FILE[: FILE.index("properties:")] + (
        "properties:\n  - {id: first, pattern: precedence, cause: asked, effect: answered}\n"
    )
    watched = Watched(tmp_path, text)
    watched.pass_time(500)
    watched.tick(1)
    watched.set_forward_ns += step_ms * MS
    watched.jump(step_ms * MS)
    watched.pass_time(700)
    watched.answer(late_by=0)
    watched.pass_time(1500)
    assert "violated" not in watched.of("first")


@pytest.mark.parametrize("step_ms", [-3_600_000, -300, -20, 20, 300, 3_600_000])
@pytest.mark.parametrize(
    "other",
    [
        "pattern: recurrence, of: asked, within: 5 s",
        "pattern: existence, of: asked, within: 1 s",
        "pattern: absence, of: answered, before: asked",
        "pattern: precedence, cause: asked, effect: answered, no_sooner: 800 ms, within: 1.45 s",
    ],
)
def test_what_was_before_the_clock_was_set_is_unknown_to_every_property(
    tmp_path, other: str, step_ms: int
):
    text = FILE[: FILE.index("properties:")] + (
        "  low: {topic: /battery, when: data < 30}\n"
        "  high: {topic: /battery, when: data > 60}\n"
        "properties:\n  - {id: first, pattern: precedence, cause: low, effect: high}\n"
        f"  - {{id: other, {other}}}\n"
    )
    watched = Watched(tmp_path, text)
    watched.pass_time(100)
    watched.tick(1)
    watched.pass_time(900)
    watched.set_forward_ns += step_ms * MS
    watched.jump(step_ms * MS)
    watched.pass_time(500)
    watched.answer(late_by=0)
    watched.pass_time(1500)
    assert "violated" not in watched.of("other")
