"""What is in a report's page, without looking at it in a browser."""

from __future__ import annotations

import json
import re
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from moon.report import write_report
from moon.report.observations import MAX_CHANNELS, MAX_NEAR, MAX_SHOWN, Shelf
from tests.report.samples import (
    HOSTILE,
    START,
    machines,
    property_violation,
    result,
    violation,
    write_log,
)
from transports.interface import Observation, ObservationKind


class Page(HTMLParser):
    """The elements of a page, and the text of its scripts."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.texts: dict[str, str] = {}
        self._inside: list[str] = []
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))
        self._inside.append(tag)

    def handle_endtag(self, tag: str) -> None:
        if tag in self._inside:
            while self._inside.pop() != tag:
                pass

    def handle_data(self, data: str) -> None:
        tag = self._inside[-1] if self._inside else ""
        self.texts[tag] = self.texts.get(tag, "") + data

    def all(self, tag: str) -> list[dict[str, str | None]]:
        return [attributes for name, attributes in self.elements if name == tag]


def data_of(page: Path) -> Any:
    found = re.search(
        r'<script type="application/json" id="data">(.*?)</script>', page.read_text(), re.DOTALL
    )
    assert found is not None
    return json.loads(found[1])


def observation(number: int, when_ns: int, channel: str = "/a") -> Observation:
    return Observation(
        stamp_ns=when_ns, received_ns=when_ns, channel=channel, kind=ObservationKind.MESSAGE,
        type_name="std_msgs/msg/Int32", data={"data": number}, source="a",
    )  # fmt: skip


def test_a_page_needs_nothing_but_itself(tmp_path: Path) -> None:
    page = tmp_path / "report.html"
    log = write_log(tmp_path / "run.jsonl", 200)
    write_report(result(log, 200, (violation(machines()[0], 5),)), page)
    found = Page(page)
    assert found.all("link") == found.all("img") == []
    assert all("src" not in script for script in found.all("script"))
    text = page.read_text()
    assert not re.findall(r"(?:src|href)=[\"']?(?:https?:)?//", text)
    assert "url(http" not in text
    assert "default-src 'none'" in text


def test_every_observation_is_in_its_channel_at_its_time(tmp_path: Path) -> None:
    page = tmp_path / "report.html"
    write_report(result(write_log(tmp_path / "run.jsonl", 240), 240), page)
    data = data_of(page)
    assert sum(len(channel["t"]) for channel in data["channels"]) == 240
    level = next(channel for channel in data["channels"] if channel["name"] == "/node0/level")
    assert set(level["k"]) == {"m"}
    assert level["t"][:2] == [0, 6_000_000]  # every 24th of 240 in a minute
    assert data["texts"][level["s"][1]] == "data: 24"
    tick = next(channel for channel in data["channels"] if channel["name"] == "/node0/tick")
    assert set(tick["k"]) == {"q", "r"}


@pytest.mark.parametrize("where", ["topic", "violation", "file"])
def test_text_from_outside_never_becomes_markup(where: str, tmp_path: Path) -> None:
    page = tmp_path / "report.html"
    log = tmp_path / "run.jsonl"
    if where == "file":
        log = tmp_path / "<script>alert(1)<_script>.jsonl"
    entry = {"topic": f"/{HOSTILE}" if where == "topic" else "/a", "time": START / 1e9 + 1}
    log.write_text(json.dumps({**entry, "text": HOSTILE + "\u2028\ud800\x1b[31m"}) + "\n")
    said = violation(machines()[0], 1, text=HOSTILE if where == "violation" else "")
    write_report(result(log, 1, (said,)), page)
    found = Page(page)
    assert len(found.all("script")) == 3
    assert found.all("img") == []
    data = data_of(page)
    assert any("</script><script>alert" in text for text in data["texts"])
    assert "\x1b" not in page.read_text()


def test_what_led_to_a_violation_is_kept_and_the_rest_thinned_out_evenly() -> None:
    count = 4 * MAX_SHOWN
    end = START + count * 10**6
    shelf = Shelf([end - 10**9])
    for number in range(count):
        shelf.take(observation(number, START + number * 10**6))
    (channel,) = shelf.channels()
    assert channel.received == count
    assert shelf.shown == len(channel.shown) <= MAX_SHOWN
    near = [one for one in channel.shown if one.near]
    assert len(near) == 2001  # every one of the two seconds before
    far = [one.number for one in channel.shown if not one.near]
    steps = {after - before for before, after in pairwise(far)}
    assert min(steps) == 8
    assert max(steps) <= 2016  # over the two seconds in which all are kept as near
    assert far[0] == 0
    assert far[-1] > count - 16


def test_violations_without_end_do_not_keep_everything() -> None:
    shelf = Shelf(range(START, START + 10**9, 10**6))
    for number in range(MAX_NEAR + 1000):
        shelf.take(observation(number, START + number))
    assert sum(one.near for channel in shelf.channels() for one in channel.shown) == MAX_NEAR


def test_channels_without_end_are_counted_and_not_kept() -> None:
    shelf = Shelf([])
    for number in range(MAX_CHANNELS + 50):
        shelf.take(observation(number, START + number, f"/channel{number}"))
    assert (len(shelf.channels()), shelf.of_other_channels) == (MAX_CHANNELS, 50)


def test_the_page_says_what_it_leaves_out(tmp_path: Path) -> None:
    page = tmp_path / "report.html"
    log = write_log(tmp_path / "run.jsonl", 10)
    found = result(log, 10, (violation(machines()[0], 1),))
    facts = replace(found.recording, faults=("run.jsonl:11: cut off",), limits=("no types",))
    write_report(replace(found, recording=facts, problems=("lost 3 messages",)), page)
    text = page.read_text()
    assert all(said in text for said in ("run.jsonl:11: cut off", "no types", "lost 3 messages"))
    log.unlink()
    write_report(replace(found, models=("/nowhere/system.xml",)), page)
    text = page.read_text()
    assert "the timeline shows no observations" in text
    assert "the models are not where they were: there are no diagrams" in text


def test_a_violation_names_the_transition_whose_place_it_has(tmp_path: Path) -> None:
    page = tmp_path / "report.html"
    log = write_log(tmp_path / "run.jsonl", 10)
    node = next(machine for machine in machines() if machine.name == "GoToPoiSkill")
    write_report(result(log, 10, (violation(node, 1, 2), property_violation(2))), page)
    articles = Page(page).all("article")
    transitions = [t for state in node.states for t in state.transitions]
    place = node.states[2].transitions[2].position
    keys = {f"d0-t{n}" for n, t in enumerate(transitions) if t.position == place}
    assert set((articles[0]["data-keys"] or "").split()) == keys
    assert "data-figure" not in articles[1]
    ids = [attributes.get("id") for _, attributes in Page(page).elements if "id" in attributes]
    assert len(ids) == len(set(ids))
    assert keys <= set(map(str, ids))


def test_the_same_result_gives_the_same_bytes(tmp_path: Path) -> None:
    log = write_log(tmp_path / "run.jsonl", 100)
    found = result(log, 100, (violation(machines()[3], 1),))
    for name in ("one.html", "other.html"):
        write_report(found, tmp_path / name)
    assert (tmp_path / "one.html").read_bytes() == (tmp_path / "other.html").read_bytes()
