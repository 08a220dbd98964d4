"""Whether nodes could be reached, by how late they were heard."""

from moon.feed.nodes import Nodes
from moon.feed.reachability import Reachability

MS = 1_000_000
LATENCY = 200 * MS


def test_what_a_node_sends_may_be_late_for_as_long_again_as_it_was():
    reachability = Reachability(LATENCY)
    reachability.heard("near", 10_000 * MS, 5 * MS)
    reachability.heard("far", 10_000 * MS, 1000 * MS)
    assert reachability.may_be_late(["near", "far"], 11_900 * MS)
    assert not reachability.may_be_late(["near", "far"], 12_100 * MS)
    assert not reachability.may_be_late(["near", "unknown"], 10_000 * MS)


def test_who_was_heard_too_late_is_told_once_it_is_not_any_more():
    nodes = Nodes(LATENCY)
    nodes.reachability.too_late("far", 800 * MS, 10_000 * MS)
    nodes.reachability.too_late("far", 700 * MS, 10_100 * MS)
    assert nodes.take_findings(10_250 * MS) == []
    (found,) = nodes.take_findings(10_400 * MS)
    assert "what far reported came up to 0.8 s late: the link between it and this monitor" in found
    assert nodes.take_findings(10_500 * MS) == []
