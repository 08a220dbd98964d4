"""XML made to break its reader: it is refused in one message, or read as what it says."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

from m2c.cli import main
from m2c.model import DiagnosticLog, xml
from m2c.model.xml import MAX_BYTES, Element, parse_xml
from m2c.model.xml_places import StartTag, start_tags

SMALL = (
    '<?xml version="1.0"?>\n'
    '<!-- a "small" <model> -->\n'
    '<scxml xmlns="http://www.w3.org/2005/07/scxml" name="M" initial="a">\n'
    "  <state id='a'><onentry><log label=\"1 &lt; 2\"/><![CDATA[<x>]]></onentry></state >\n"
    "</scxml>\n"
)


def parsed(content: bytes) -> tuple[Element | None, list[str]]:
    """The root, and what is said of the file, without the warning on namespaces."""
    log = DiagnosticLog()
    root = parse_xml(content, "f", log)
    said = [str(found) for found in log.diagnostics if found.rule != "xml-namespace"]
    return root, said


def refusal(content: bytes) -> str:
    _, said = parsed(content)
    assert len(said) == 1, said
    return said[0]


def test_a_document_that_was_cut_off_anywhere_is_one_error() -> None:
    content = SMALL.encode()
    whole = len(content.rstrip())
    for length in range(whole):
        said = refusal(content[:length])
        assert re.fullmatch(r"f:[1-5]:\d+: error: .* \[malformed-xml\]", said), (length, said)
    assert parsed(content[:whole])[1] == []


def test_a_document_that_ends_says_which_element_is_open() -> None:
    assert refusal(b"<scxml>\n<state>") == (
        "f:2:8: error: malformed XML: the document ends; <state> of 2:1 is open; write </state> where it ends [malformed-xml]"
    )


def repeated(before: bytes, part: bytes, after: bytes = b"") -> bytes:
    """``part`` as often as it fits into the largest file that is read."""
    return before + part * ((MAX_BYTES - len(before) - len(after)) // len(part)) + after


@pytest.mark.parametrize(
    ("content", "place", "reason"),
    [
        (repeated(b"<a ", b"x='\" "), "1:12", "ends with the ' before this"),
        (repeated(b"<a", b' x="'), "1:1", "unclosed token"),
        (repeated(b"<a>", b"<"), "1:4", "invalid token"),
        (repeated(b"<a>", b"<!--"), "1:4", "unclosed token"),
        (repeated(b"<a>", b"<![CDATA["), "1:4", "unclosed token"),
        (repeated(b"<a>", b"<?"), "1:4", "unclosed token"),
        (repeated(b"<a>", b"&lt"), "1:4", "invalid token"),
        (repeated(b"<a x='", b"&"), "1:7", "a raw && in the value of `x`"),
        (repeated(b"<a ", b" "), "1:1", "unclosed token"),
        (repeated(b"<a", b" x = ''", b"/>"), "1:11", "duplicate attribute"),
        (repeated(b"<a>", b"</a>"), "1:8", "junk after document element"),
        (repeated(b"<", b"y", b"/>"), f"1:{MAX_BYTES - 1}", "Name too long"),
        (repeated(b"<a>", b"]]>", b"</a>"), "1:4", "Sequence ']]>' not allowed"),
        (repeated(b"<a>&#", b"1", b";</a>"), "1:4", "reference to invalid character number"),
        (repeated(b"<!DOCTYPE ", b"x"), f"1:{MAX_BYTES + 1}", "document type declaration"),
        (repeated(b"<?xml ", b" encoding ", b"?><a/>"), "1:8", "Malformed declaration"),
        (repeated(b"", b"<a>"), "1:193", "nested more than 64 deep"),
    ],
    ids=lambda value: value[:12] if isinstance(value, bytes) else None,
)
def test_four_megabytes_of_one_mistake_are_one_short_error(
    content: bytes, place: str, reason: str
) -> None:
    said = refusal(content)  # pytest's time limit is the bound on the work
    assert said.startswith(f"f:{place}: error: ")
    assert reason in said
    assert len(said) < 500


@pytest.mark.parametrize(
    "content",
    [
        repeated(b"<a x='", b"y", b"'/>"),
        repeated(b"<a x='", b"&lt;", b"'/>"),
        repeated(b"<a>", b"&lt;", b"</a>"),
        repeated(b"<a>", b">", b"</a>"),
        repeated(b"<a>", b"\n", b"</a>"),
        repeated(b"<a ", b" ", b"/>"),
        repeated(b"<a>", b"<!---->", b"</a>"),
        repeated(b"<a>", b"<?x?>", b"</a>"),
        repeated(b"<a>", b"<![CDATA[]]>", b"</a>"),
        repeated(b"", b"<!---->", b"<a/>"),
    ],
    ids=lambda content: content[:12],
)
def test_four_megabytes_that_are_xml_are_read(content: bytes) -> None:
    root, said = parsed(content)
    assert said == []
    assert root is not None
    assert root.tag == "a"


def test_a_long_value_is_kept_whole() -> None:
    root, _ = parsed(repeated(b"<a x='", b"&lt;", b"'/>"))
    assert root is not None
    assert set(root.attributes["x"]) == {"<"}
    assert len(root.attributes["x"]) == (MAX_BYTES - len("<a x=''/>")) // 4


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"<a>&#0;</a>", "1:4: error: malformed XML: reference to invalid character number"),
        (b"<a x='\xc3\xa4&#xD800;'/>", "1:8: error: malformed XML: reference to invalid character number"),
        (b"<a>\xed\xa0\x80</a>", "1:4: error: malformed XML: the byte 0xed, number 4 of the file, is not UTF-8, which is read where none is declared; write the file in UTF-8"),
        (b"<a>\0</a>", "1:4: error: malformed XML: not well-formed (invalid token); <a> of 1:1 is open"),
        (b"<a>\n<b x='\x1b[2J'/></a>", "2:7: error: malformed XML: not well-formed (invalid token); <a> of 1:1 is open"),
        (b"<a>x & y</a>", "1:6: error: malformed XML: not well-formed (invalid token); <a> of 1:1 is open; write &amp; for &"),
        (b"<a>x < y</a>", "1:6: error: malformed XML: not well-formed (invalid token); <a> of 1:1 is open; write &lt; for <"),
        (b"<a x='&lol;'/>", "1:7: error: malformed XML: undefined entity"),
        (
            b"""<a x="y == "z" ? 1 : 2"/>""",
            "1:13: error: malformed XML: the value of `x` ends with the \" before this; write a text in the value with ', and a blank after the value",
        ),
        (
            b"""<a x='1'y='2'/>""",
            "1:9: error: malformed XML: the value of `x` ends with the ' before this; write a text in the value with \", and a blank after the value",
        ),
        (b"<a x=1/>", "1:6: error: malformed XML: a value without quotes; write it like name=\"value\""),
        (b"<a x/>", "1:5: error: malformed XML: not well-formed (invalid token)"),
        (b"<a><b></a>", "1:9: error: malformed XML: mismatched tag </a>; <b> of 1:4 is open; write </b> before it"),
        (b"</a>", "1:1: error: malformed XML: not well-formed (invalid token); write &lt; for <"),
        (b"text", "1:1: error: malformed XML: not well-formed (invalid token)"),
        (b"<!-- nothing -->", "1:17: error: malformed XML: no element"),
        (b"<a/>\n&lt;", "2:1: error: malformed XML: junk after document element"),
        (b"<a/><!DOCTYPE a []>", "1:5: error: malformed XML: junk after document element"),
        (b"<a><!DOCTYPE a []></a>", "1:4: error: malformed XML: not well-formed (invalid token); <a> of 1:1 is open; write &lt; for <"),
        (b"<?xml version='1'?><a/>", "1:18: error: malformed XML: Malformed declaration expecting version; write <?xml version=\"1.0\" encoding=\"UTF-8\"?>"),
        (b"<a x:='1'/>", "1:6: error: malformed XML: Failed to parse QName 'x:'"),
    ],
)  # fmt: skip
def test_what_is_no_xml_is_said_with_its_place(content: bytes, said: str) -> None:
    assert refusal(content) == f"f:{said} [malformed-xml]"


@pytest.mark.parametrize(
    "content",
    [
        b'<!DOCTYPE a [<!ENTITY b "&c;&c;"><!ENTITY c "ha">]><a>&b;</a>',
        b'<!DOCTYPE a [<!ENTITY b SYSTEM "file:///etc/passwd">]><a>&b;</a>',
        b'<!DOCTYPE a [<!ENTITY % b SYSTEM "http://localhost/x"> %b;]><a/>',
        b"<!-- first --><?then?>\n<!DOCTYPE a><a/>",
        "<!DOCTYPE a><a/>".encode("utf-16"),
    ],
)
def test_a_document_type_is_refused_wherever_it_may_stand(content: bytes) -> None:
    said = refusal(content)
    assert "a document type declaration (<!DOCTYPE a…>) is refused" in said
    assert said.endswith("[hostile-xml]")


@pytest.mark.parametrize("text", ["<!DOCTYPE a>", "<b x='1>", "</b>", "<?b?"])
def test_what_looks_like_markup_in_a_comment_is_none(text: str) -> None:
    root, said = parsed(f"<a><!-- {text} --><c/></a>".encode())
    assert said == []
    assert root is not None
    assert [str(child.position) for child in root.children] == [f"f:1:{len(text) + 13}"]


def test_an_inclusion_is_markup_of_another_namespace_like_any_other() -> None:
    root, said = parsed(
        b'<a xmlns:xi="http://www.w3.org/2001/XInclude"><xi:include href="/etc/passwd"/></a>'
    )
    what = "`xi:include` is of another namespace: all such markup is ignored"
    assert said == [f"f:1:47: note: {what} [ignored-element]"]
    assert root is not None
    assert root.children == []


@pytest.mark.parametrize(
    "encoding",
    [
        "utf-7",
        "UTF-7",
        "utf-32",
        "none-8",
        "iso-8859-12",
        "cp037",
        "idna",
        "unicode_escape",
        "rot13",
    ],
)
def test_an_encoding_that_hides_markup_or_does_not_exist_is_refused(encoding: str) -> None:
    assert refusal(f'<?xml version="1.0" encoding="{encoding}"?><a/>'.encode()) == (
        f"f:1:31: error: unknown encoding: {encoding}; write the file in UTF-8 [malformed-xml]"
    )


def test_markup_in_utf_7_stays_text() -> None:
    root, said = parsed(b"<a>+ADw-b/+AD4-</a>")
    assert said == []
    assert root is not None
    assert root.children == []
    assert root.text == "+ADw-b/+AD4-"


def test_an_encoding_that_the_bytes_are_not_in_is_refused() -> None:
    assert refusal(b'<?xml version="1.0" encoding="utf-16"?><a/>') == (
        "f:1:31: error: the file declares utf-16, and is not in it; write the file in UTF-8 "
        "[malformed-xml]"
    )
    assert refusal(b'<?xml version="1.0" encoding="us-ascii"?>\n<a x="\xc3\xa4"/>') == (
        "f:2:7: error: malformed XML: the byte 0xc3, number 49 of the file, is not ASCII, which it declares; write the file in UTF-8 "
        "[malformed-xml]"
    )


@pytest.mark.parametrize(
    ("encoding", "codec"),
    [
        ("utf-8", "utf-8"),
        ("UTF-8", "utf-8-sig"),
        ("utf-16", "utf-16"),
        ("utf-16", "utf-16-le"),
        ("utf-16", "utf-16-be"),
        ("iso-8859-1", "latin-1"),
        ("ISO-8859-15", "iso-8859-15"),
        ("windows-1252", "cp1252"),
    ],
)
def test_every_encoding_gives_the_same_element(encoding: str, codec: str) -> None:
    text = f'<?xml version="1.0" encoding="{encoding}"?>\n<a x="ä"><b  y="ö">ü</b></a>'
    root, said = parsed(text.encode(codec))
    assert said == []
    assert root is not None
    (inner,) = root.children
    assert (root.attributes, inner.attributes, inner.text) == ({"x": "ä"}, {"y": "ö"}, "ü")
    assert str(inner.at("y")) == "f:2:17"


@pytest.mark.parametrize("ending", ["\n", "\r\n", "\r"])
def test_every_line_ending_gives_the_same_places_and_values(ending: str) -> None:
    text = "<a\n  x=\"1\n2\"\n>t\n<b\n\ty = '3'/></a>".replace("\n", ending)
    root, said = parsed(text.encode())
    assert said == []
    assert root is not None
    (inner,) = root.children
    assert (root.attributes, root.text) == ({"x": "1 2"}, "t\n")
    places = (root.at("x"), inner.position, inner.at("y"))
    assert list(map(str, places)) == ["f:2:6", "f:5:1", "f:6:7"]


def test_undeclared_prefixes_count_for_nothing_and_other_namespaces_are_ignored() -> None:
    root, said = parsed(
        b'<a b:x="1" xmlns:c="urn:c" c:y="2" xml:lang="en" xsi:z="3" q="4">t<b:d/>u<c:e><f/></c:e>v</a>'
    )
    assert said == [
        "f:1:67: note: <d>: `b:d` is read as `d`; names are read without an undeclared prefix "
        "[older-spelling]",
        "f:1:9: note: `b:x` is of another namespace: all such markup is ignored [ignored-element]",
    ]
    assert root is not None
    assert root.attributes == {"q": "4"}
    assert [child.tag for child in root.children] == ["d"]
    assert root.text == "tuv"
    assert str(root.at("q")) == "f:1:63"


SCXML = "http://www.w3.org/2005/07/scxml"
OWN = [
    (f'<scxml xmlns="{SCXML}">{{}}</scxml>', ""),
    (f'<s:scxml xmlns:s="{SCXML}">{{}}</s:scxml>', "s:"),
    (f'<scxml xmlns="{SCXML}" xmlns:s="{SCXML}">{{}}</scxml>', "s:"),
]
FOREIGN = ('<qt:info xmlns:qt="urn:qt" id="b"><state/></qt:info>', '<info xmlns="urn:other"/>')


@pytest.mark.parametrize(("head", "prefix"), OWN)
@pytest.mark.parametrize("foreign", ["", *FOREIGN])
def test_names_of_the_root_s_namespace_are_read_with_any_prefix(
    head: str, prefix: str, foreign: str
) -> None:
    state = f'<{prefix}state id="a" my:id="c" my:initial="b" xmlns:my="urn:my">{foreign}</{prefix}state>'
    root, said = parsed(head.format(f"{state}{foreign}").encode())
    assert [line.rpartition(" ")[2] for line in said] == ["[ignored-element]"]
    assert root is not None
    assert [(child.tag, child.attributes, child.children) for child in root.children] == [
        ("state", {"id": "a"}, [])
    ]


@pytest.mark.parametrize(
    ("text", "attributes"),
    [
        ('<a b:x="1" x="2"/>', {"x": "2"}),
        ('<a x="2" b:x="1"/>', {"x": "2"}),
        ('<a my:initial="s"/>', {}),
        ('<s:a s:x="1" my:y="2" z="3"/>', {"x": "1", "z": "3"}),
        ('<s:a s:x="1" x="2"/>', {"x": "2"}),
    ],
)
def test_an_attribute_is_its_element_s_own_without_a_prefix_or_with_the_same(
    text: str, attributes: dict[str, str]
) -> None:
    root, _ = parsed(text.encode())
    assert root is not None
    assert root.attributes == attributes


PIECES = [b"<", b">", b"&", b'"', b"'", b"/>", b"</", b"<!--", b"-->", b"<![CDATA[", b"]]>"]
PIECES += [b"<?", b"?>", b"\0", b"\xff", b"\r", b"=", b":", b"xmlns:x='y'", b"&#0;", b"<b c='1'>"]


@given(
    st.lists(
        st.tuples(st.integers(0, len(SMALL)), st.integers(0, 3), st.sampled_from([b"", *PIECES])),
        min_size=1,
        max_size=4,
    )
)
def test_a_damaged_document_is_read_or_refused_in_one_error_a_line(
    damages: list[tuple[int, int, bytes]],
) -> None:
    content = SMALL.encode()
    for at, removed, added in damages:
        content = content[:at] + added + content[at + removed :]
    root, said = parsed(content)
    errors = [message for message in said if ": error: " in message]
    assert errors or root is not None
    assert len({message.split(":")[1] for message in errors}) == len(errors), said


def test_places_that_do_not_fit_the_tree_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    content = b"<a>\n<b/><c/></a>"
    tags = start_tags(content.decode())
    what = "error: malformed XML: which element this is is not clear [malformed-xml]"
    for wrong, place in [
        (tags[:2], "2:1"),
        ([*tags, tags[1]], "2:1"),
        ([tags[0], tags[2], tags[1]], "2:5"),
        ([tags[0], tags[1], StartTag("c", 9, {"d": 11})], "2:6"),
    ]:
        monkeypatch.setattr(xml, "start_tags", lambda *_, found=wrong: found)
        assert refusal(content) == f"f:{place}: {what}"


@pytest.mark.parametrize(
    "content",
    [
        b'<?xml version="1.0" encoding="utf-7"?><scxml/>',
        b'<!DOCTYPE a [<!ENTITY b "ha">]><scxml name="&b;"/>',
        b"<scxml>" * 1_000,
        b"\xff\xfe<\0",
        b"<scxml name='\0'/>",
    ],
)
@pytest.mark.parametrize("name", ["m.scxml", "system.xml"])
def test_the_command_line_says_one_error(tmp_path: Path, name: str, content: bytes) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    result = CliRunner().invoke(main, ["check", str(path)])
    assert result.exit_code == 2
    assert isinstance(result.exception, SystemExit)
    (line,) = [line for line in result.output.splitlines() if ": error: " in line]
    assert re.match(rf"{re.escape(str(path))}:1:\d+: error: ", line)


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (
            "<a>\n <b>\n</a>",
            "3:3: error: malformed XML: mismatched tag </a>; <b> of 2:2 is open; write </b> before it",
        ),
        (
            "<a>\n <state>\n</stat></a>",
            "3:3: error: malformed XML: mismatched tag </stat>; <state> of 2:2 is open; one of the two is misspelt",
        ),
        (
            "<a>\n <b></xyz></a>",
            "2:7: error: malformed XML: mismatched tag </xyz>; <b> of 2:2 is open; </b> is due",
        ),
        (
            "<a>\n <b>",
            "2:5: error: malformed XML: the document ends; <b> of 2:2 is open; write </b> where it ends",
        ),
        (
            '<a>\n <b x="1>\n <c/></b></a>',
            '2:7: error: malformed XML: the value of `x` does not end; <a> of 1:1 is open; write " after it',
        ),
        (
            "<a x='1>\n<c/></a>",
            "1:6: error: malformed XML: the value of `x` does not end; write ' after it",
        ),
        (
            '<a x="1 < 2"/>',
            "1:9: error: malformed XML: a raw < in the value of `x`; write &lt; for <",
        ),
        (
            "<a><b y='0' x='p&&q'/></a>",
            "1:17: error: malformed XML: a raw && in the value of `x`; write &amp; for &: &amp;&amp;",
        ),
        (
            '<a>\n<b x="p > 1 && q < 2"/>\n</a>',
            "2:13: error: malformed XML: a raw && in the value of `x`; write &amp; for &: &amp;&amp;",
        ),
        (
            "<a>\n<b x='p->q <r'/>\n</a>",
            "2:12: error: malformed XML: a raw < in the value of `x`; write &lt; for <",
        ),
        (
            '<a>\n<b x="p := 1;\n  q := p < 2"/>\n</a>',
            "3:10: error: malformed XML: a raw < in the value of `x`; write &lt; for <",
        ),
        (
            '<a>\n<b x="1\n <c/></a>',
            '2:6: error: malformed XML: the value of `x` does not end; <a> of 1:1 is open; write " after it',
        ),
        (
            '<a x="p &amp; q & r"/>',
            "1:17: error: malformed XML: a raw & in the value of `x`; write &amp; for &",
        ),
    ],
)
def test_an_xml_error_names_the_tag_that_was_left_open_and_its_place(
    content: str, expected: str
) -> None:
    log = DiagnosticLog()
    parse_xml(content.encode(), "f", log)
    assert [str(item) for item in log.diagnostics] == [f"f:{expected} [malformed-xml]"]


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (
            b'<?xml version="1.0" encoding="UTF-8"?>\r\n<a>\xe9</a>',
            "2:4: error: malformed XML: the byte 0xe9, number 44 of the file, is not UTF-8, which it declares",
        ),
        (
            b"\xef\xbb\xbf<a>\xe9</a>",
            "1:4: error: malformed XML: the byte 0xe9, number 7 of the file, is not UTF-8, which its byte-order mark names",
        ),
        (
            b"<a>\xe9</a>",
            "1:4: error: malformed XML: the byte 0xe9, number 4 of the file, is not UTF-8, which is read where none is declared",
        ),
    ],
)
def test_an_encoding_error_names_the_encoding_and_the_byte(content: bytes, expected: str) -> None:
    log = DiagnosticLog()
    parse_xml(content, "f", log)
    hint = "write the file in UTF-8"
    assert [str(item) for item in log.diagnostics] == [f"f:{expected}; {hint} [malformed-xml]"]


def test_reading_goes_on_after_what_was_not_escaped_and_not_ended() -> None:
    root, said = parsed(
        b"<a>\n<b x='1 < 2 && 3 < 4' y='5'/>\n<c>one & two\n<d><e></d>\n</c><f/>\n</a>"
    )
    assert said == [
        "f:2:9: error: malformed XML: a raw < in the value of `x`; write &lt; for < [malformed-xml]",
        "f:3:8: error: malformed XML: not well-formed (invalid token); <c> of 3:1 is open; write &amp; for & [malformed-xml]",
        "f:4:9: error: malformed XML: mismatched tag </d>; <e> of 4:4 is open; write </e> before it [malformed-xml]",
    ]
    assert root is not None
    b, c, f = root.children
    assert (b.attributes, str(b.at("y"))) == ({"x": "1 < 2 && 3 < 4", "y": "5"}, "f:2:26")
    assert (c.text, [child.tag for child in c.children]) == ("one & two\n\n", ["d"])
    assert (f.tag, str(f.position)) == ("f", "f:5:5")


def test_a_quote_that_is_missing_is_not_taken_for_what_was_not_escaped() -> None:
    said = refusal(b"<a>\n<b x='1/>\n<c y='2'/>\n</a>")
    assert said.startswith("f:2:6: error: malformed XML: the value of `x` does not end")
