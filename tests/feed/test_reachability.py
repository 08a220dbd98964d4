"""Whether nodes could be reached, by how late they were heard."""

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
