"""The JUnit report is XML that every reader takes, whatever is in paths and reasons."""

from __future__ import annotations

from lxml import etree

from moon.offline.junit import junit


def test_a_path_of_any_bytes_gives_a_report_that_can_be_read() -> None:
    path = b"run \x1b[31m<&\"'>\xff.mcap".decode("utf-8", "surrogateescape")
    (suite,) = etree.fromstring(junit([], [(path, "damaged at \0\x07\ufffe")]))
    assert suite.get("name") == "run �[31m<&\"'>�.mcap"
    (error,) = suite.iter("error")
    assert error.get("message") == "damaged at ���"


def test_the_report_says_its_encoding_and_ends_in_a_line_end() -> None:
    content = junit([], [("größe", "")])
    assert content.startswith(b"<?xml version='1.0' encoding='utf-8'?>\n<testsuites ")
    assert "größe".encode() in content
    assert content.endswith(b"</testsuites>\n")
