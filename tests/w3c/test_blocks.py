"""Each ``<onentry>`` and ``<onexit>`` is a block of its own (W3C SCXML 3.8, 3.9; tests 375 to 378)."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.w3c.both import Both, probe, say

DATA = '<datamodel><data id="items" expr="[1]"/><data id="n" type="int32" expr="0"/></datamodel>'
FAILS = '<assign location="n" expr="items[7].x"/>'
ERRORS = f'<transition event="error.execution">{say(9)}</transition>'


def test_blocks_run_in_document_order(tmp_path: Path) -> None:  # W3C tests 375, 377
    entry = f"<onentry>{say(1)}</onentry><onentry>{say(2)}</onentry>"
    leaving = f"<onexit>{say(3)}</onexit><onexit>{say(4)}</onexit>"
    go = '<transition event="go" target="b"/>'
    both = Both(tmp_path, probe(f'<state id="a">{go}{entry}{leaving}</state><state id="b"/>'))
    assert both.said == [1, 2]
    assert both.take("go") == [3, 4]


@pytest.mark.parametrize("failing", [0, 1, 2])
@pytest.mark.parametrize("tag", ["onentry", "onexit"])
def test_an_error_ends_its_block_only(tag: str, failing: int, tmp_path: Path) -> None:  # 376, 378
    blocks = [
        f"<{tag}>{say(n)}{FAILS if n == failing else ''}{say(n + 4)}</{tag}>" for n in range(3)
    ]
    seen = "".join((*blocks[:1], f"<{tag}/>", *blocks[1:]))
    there = f"{seen if tag == 'onentry' else ''}{ERRORS}"
    begin = f'<state id="a">{seen if tag == "onexit" else ""}<transition event="go" target="b"/></state>'
    both = Both(tmp_path, probe(f'{DATA}{begin}<state id="b">{there}</state>'))
    said = both.take("go")
    done = [[n] if n == failing else [n, n + 4] for n in range(3)]
    assert said == [*done[0], *done[1], *done[2], 9]


def test_each_block_that_fails_is_an_error(tmp_path: Path) -> None:
    block = f"<onentry>{say(1)}{FAILS}{say(2)}</onentry>"
    both = Both(tmp_path, probe(f'{DATA}<state id="a">{block}{block}{ERRORS}</state>'))
    assert both.said == [1, 1, 9, 9]
