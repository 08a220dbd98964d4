"""Calls of which one end was heard: what is too old is what a look at all of them would find."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from moon.policy.calls import Call, SeenByServer

MOST = 5
ACTS = st.tuples(st.sampled_from(["note", "forget", "until"]), st.integers(0, 8), st.integers(0, 9))


@given(st.lists(ACTS, max_size=40))
def test_as_looking_at_all_of_them(acts: list[tuple[str, int, int]]) -> None:
    heard = SeenByServer(MOST)
    kept: dict[Call, int] = {}
    for act, number, stamp in acts:
        call = ("/Battery/tick", "policy", number)
        if act == "note":
            heard.note(call, stamp)
            kept[call] = min(stamp, kept.get(call, stamp))
            if len(kept) > MOST:
                del kept[next(iter(kept))]
        elif act == "forget":
            heard.forget(call)
            kept.pop(call, None)
        else:
            old = [one for one, at in kept.items() if at <= stamp]
            assert heard.forget_until(stamp) == len(old)
            kept = {one: at for one, at in kept.items() if one not in old}
    assert heard.forget_until(10) == len(kept)
    heard.note(("/Battery/tick", "policy", 1), 3)
    heard.clear()
    assert heard.forget_until(10) == 0
