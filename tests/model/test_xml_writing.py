"""What is written as XML reads back as it was, whatever text is in it."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from m2c.model.xml_writing import below, element, read_back, serialised

# all that XML 1.0 has, but the characters that its reader takes for blanks of the layout
TEXT = st.text(st.characters(exclude_categories=["Cs", "Cc"], exclude_characters="\ufffe\uffff"))


@given(TEXT, TEXT)
def test_values_and_texts_come_back(value: str, text: str) -> None:
    root = element("a", {"x": value})
    below(root, "b", {"y": f"\t{value}\r\n"}, text)
    back = read_back(serialised(root))
    assert back.get("x") == value
    assert back[0].get("y") == f"\t{value}\r\n"
    assert (back[0].text or "") == text


def test_each_character_that_xml_does_not_have_is_seen_to_be_missing() -> None:
    root = element("a", {"x": "\x1b[31m\0\ud800"}, "b\x07\uffff")
    assert serialised(root) == '<a x="�[31m��">b��</a>\n'


def test_children_stand_in_lines_of_their_own() -> None:
    root = element("a", {"z": "1", "b": "2"})
    below(below(root, "c", {}), "d", {})
    assert serialised(root) == '<a z="1" b="2">\n  <c>\n    <d/>\n  </c>\n</a>\n'
