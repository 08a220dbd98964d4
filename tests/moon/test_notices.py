"""What the tap says of itself, it says once."""

from __future__ import annotations

from moon.tap.notices import Notices

UNLINKED = "far is up, but not linked to this tap: its messages are not received"


def missed(count: int, channel="/robot/1/x") -> str:
    return f"missed {count} message{'s' * (count != 1)} on {channel} from n"


def test_links_are_said_when_they_change() -> None:
    said: list[str] = []
    notices = Notices(said.append)
    for peers in (["b", "a"], ["a", "b"], ["a"], ["a"], ["a", "d", "c"], ["b", "c"], [], ["a"]):
        notices.links(peers)
    assert said == [
        "linked to 2 nodes: a, b",
        "linked to 1 node: - b",
        "linked to 3 nodes: + c, d",
        "linked to 2 nodes: + b; - a, d",
        "no longer linked to any node",
        "linked to 1 node: a",
    ]


def test_of_many_links_only_some_are_named() -> None:
    said: list[str] = []
    notices = Notices(said.append)
    names = [f"node_{number:02}" for number in range(48)]
    notices.links(names)
    notices.links(names[:1])
    first = ", ".join(names[:8])
    assert said == [
        f"linked to 48 nodes: {first} and 40 more",
        f"linked to 1 node: - {', '.join(names[1:9])} and 39 more",
    ]


def test_a_tap_that_is_linked_to_nobody_says_so_once() -> None:
    said: list[str] = []
    notices = Notices(said.append)
    for _ in range(5):
        notices.links([])
    assert said == [
        "not linked to any node yet: nothing can be received until one starts; "
        "is this the endpoint where the nodes meet?"
    ]


def test_who_listens_before_nodes_are_started_does_not_ask_where_they_meet() -> None:
    said: list[str] = []
    notices = Notices(said.append, is_first=True)
    for peers in ([], [], [], ["a"], [], []):
        notices.links(peers)
    assert said == ["linked to 1 node: a", "no longer linked to any node"]


def test_a_growing_loss_is_said_when_it_doubles_and_in_full_at_the_end() -> None:
    said: list[str] = []
    notices = Notices(said.append)
    for count in range(1, 101):
        notices.problems([missed(count)])
    assert said == [f"warning: {missed(count)}" for count in (1, 2, 4, 8, 16, 32, 64)]
    notices.last_problems([missed(100)])
    notices.last_problems([missed(100)])
    assert said[7:] == [f"warning: {missed(100)}"]


def test_losses_on_channels_that_differ_by_a_number_are_told_apart() -> None:
    said: list[str] = []
    notices = Notices(said.append)
    notices.problems([missed(3, "/robot/1/x"), missed(3, "/robot/2/x")])
    assert len(said) == 2


def test_a_node_that_is_linked_a_moment_later_is_no_warning() -> None:
    said: list[str] = []
    notices = Notices(said.append)
    notices.problems([UNLINKED])
    notices.problems([])
    notices.last_problems([])
    assert said == []


def test_a_node_that_stays_unlinked_is_warned_of_once() -> None:
    said: list[str] = []
    notices = Notices(said.append)
    for _ in range(4):
        notices.problems([UNLINKED])
    notices.last_problems([UNLINKED])
    assert said == [f"warning: {UNLINKED}"]
