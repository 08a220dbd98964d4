"""Filters: channel globs, nodes, kinds."""

from __future__ import annotations

from fnmatch import fnmatchcase

import pytest

from moon.tap.selection import GlobError, Selection, check, matches
from moon.tap.stream import Line


def line(channel="/a/b", kind="message", source="node", client="", action="") -> Line:
    return Line(0, kind, channel, source, client=client, action=action)


GOAL = line("/nav/go/_action/send_goal", "request", "skill", action="/nav/go")


@pytest.mark.parametrize(
    ("channel", "glob", "expected"),
    [
        ("/a/b", "/a/*", True),
        ("/a/b/c", "/a/*", False),
        ("/a/b/c", "/a/**", True),
        ("/a", "/a/**", True),
        ("/ab", "/a/**", False),
        ("/ab", "/a", False),
        ("/ab", "/a?", True),
        ("/a/b/c", "/**/c", True),
        ("/a/b", "**", True),
        ("/a/b/tick", "*/tick", False),
        ("/a/tick", "/*/tick", True),
        ("/a.b", "/a?b", True),
        ("/a[b]", "/a[b]", True),
    ],
)
def test_a_star_stays_within_one_part_unless_doubled(channel, glob, expected) -> None:
    assert matches(channel, glob) is expected


@pytest.mark.parametrize("glob", ["/nav/go", "/nav/go/**", "/nav/*", "/nav/**"])
def test_a_glob_that_matches_an_action_shows_its_parts(glob) -> None:
    assert Selection([glob]).takes(GOAL)


def test_one_part_of_an_action_can_be_selected() -> None:
    selection = Selection(["/nav/go/_action/feedback"])
    assert not selection.takes(GOAL)
    assert selection.takes(line("/nav/go/_action/feedback", action="/nav/go"))


def test_kind_action_is_every_part_of_an_action_and_nothing_else() -> None:
    selection = Selection(kinds=["action"])
    assert selection.takes(GOAL)
    assert selection.takes(line("/nav/go/_action/feedback", action="/nav/go"))
    assert not selection.takes(line())


def test_kinds_add_up() -> None:
    selection = Selection(kinds=["message", "response"])
    assert selection.takes(line())
    assert selection.takes(line(kind="response"))
    assert not selection.takes(line(kind="request"))


def test_a_node_is_who_sends_asks_or_answers() -> None:
    selection = Selection(nodes=["skill*"])
    assert selection.takes(line(source="skill1"))
    assert selection.takes(line(kind="response", source="server", client="skill2"))
    assert not selection.takes(line(kind="response", source="server", client="other"))


def test_an_unknown_answerer_matches_no_glob() -> None:
    assert not Selection(nodes=["*"]).takes(line(kind="response", source="", client=""))


@pytest.mark.parametrize(
    "glob", ["/a/b", "/a/*", "/a/**", "/**", "/x[1]/**", "/*/tick", "/a/**/c", "/a?"]
)
def test_what_the_transport_is_asked_for_holds_all_that_matches(glob) -> None:
    tapped = Selection([glob]).tapped()
    for channel in ("/a", "/a/b", "/a/b/c", "/x[1]", "/x[1]/y", "/q/tick", "/ab", "/a/c"):
        if matches(channel, glob):
            assert any(fnmatchcase(channel, wide) for wide in tapped), channel


@pytest.mark.parametrize(
    ("glob", "message"),
    [
        ("level", "'level' matches no channel: a channel starts with '/'; write '/level'"),
        ("/a//b", "'/a//b' matches no channel: it has an empty part"),
        ("/a/", "'/a/' matches no channel: it has an empty part"),
        ("/a$b", "'/a$b' matches no channel: no channel has '$' in its name"),
        ("/a b", "'/a b' matches no channel: no channel has ' ' in its name"),
    ],
)
def test_a_glob_that_can_match_nothing_is_refused(glob, message) -> None:
    with pytest.raises(GlobError) as error:
        check(glob)
    assert str(error.value) == message


def test_messages_taken_are_shown_only_if_asked_for() -> None:
    taken = line(kind="taken")
    assert not Selection().takes(taken)
    assert not Selection(kinds=["message"]).takes(taken)
    assert Selection(kinds=["taken"]).takes(taken)
    assert not Selection(kinds=["taken"]).takes(line())
    of_action = line("/nav/go/_action/feedback", "taken", action="/nav/go")
    assert not Selection(kinds=["action"]).takes(of_action)
    assert Selection(kinds=["taken"]).takes(of_action)
