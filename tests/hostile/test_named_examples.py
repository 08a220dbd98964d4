"""Models that once passed the check and became code, or code that does not run: one test each."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.hostile.importing import import_all
from tests.hostile.judging import Accepted, Refused, judge
from tests.hostile.models import Case, slots_of

pytestmark = pytest.mark.slow

MACHINE = ("machine",)
TOPICS = ("topics",)
SERVICES = ("services",)
ACTION = ("action",)
TREE = ("tree",)
WARNING = (
    'Warning (level 3), see "manual", and then turn it off, (or call us), {or not}, and so on, soon'
)


@pytest.fixture(scope="module")
def imported(tmp_path_factory: pytest.TempPathFactory) -> Iterator[list[Accepted]]:
    """Systems whose packages are imported when all tests of this file are done, in one process."""
    accepted: list[Accepted] = []
    yield accepted
    import_all(accepted, tmp_path_factory.mktemp("generated"))


def accept(later: list[Accepted], *cases: Case) -> None:
    """Judge ``cases``, which the check must accept; what is generated is imported ``later``."""
    for case in cases:
        found = judge(case)
        assert isinstance(found, Accepted), (case, found)
        later.append(found)


def everywhere(kinds: set[str], text: str) -> list[Case]:
    """A case of each shape with ``text`` in every slot of ``kinds`` (and a number where names differ)."""
    cases = []
    for shape in (MACHINE, TOPICS, SERVICES, ACTION, TREE):
        slots = [slot for slot in slots_of(shape) if slot.kind in kinds]
        texts = {
            slot.name: f"{text}{number}" if slot.scope else text
            for number, slot in enumerate(slots)
        }
        cases.append(Case(shape, texts))
    return cases


@pytest.mark.parametrize("text", [WARNING, f"two  blanks, ({WARNING}),  at, both, (ends)"])
def test_a_text_with_brackets_and_commas_stays_as_it_is(
    text: str, imported: list[Accepted]
) -> None:
    accept(imported, *everywhere({"label", "text", "literal", "comment"}, text))


@pytest.mark.parametrize(
    "text",
    [
        *(
            "\\N{x}",
            "\\",
            '"',
            "'",
            '"""',
            "'''",
            "{x}",
            "%s",
            "\\x",
            "#",
            "{{x}}",
            "{%x%}",
            "${x}",
        ),
        '"""+__import__("os").system("touch(PWNED)")+"""',
        '");__import__("os").system("touch(PWNED)");("',
        "');__import__('os').system('touch(PWNED)');('",
    ],
)
def test_a_name_with_what_python_means_something_by_is_only_a_name(
    text: str, imported: list[Accepted]
) -> None:
    kinds = {"name", "event"} if set(text) & set("#$") else {"name", "event", "channel"}
    accept(imported, *everywhere(kinds, text))  # no middleware takes a channel with # or $


SEEN_BY_THE_TREE_ONLY = ("sequence", "leaf", "plugin leaf", "main tree", "sub tree")
"""Names in a policy, which BehaviorTree.CPP judges."""


@pytest.mark.parametrize("shape", [MACHINE, TOPICS, SERVICES, ACTION, TREE])
@pytest.mark.parametrize("text", ["a\nb", "a\u202eb", "a\u200bb", "x" * 256])
def test_a_name_that_cannot_be_seen_or_is_too_long_is_refused(
    shape: tuple[str, ...], text: str
) -> None:
    for slot in slots_of(shape):
        splits = "\n" in text and slot.kind == "event"  # in a transition, into two events
        if slot.kind not in ("name", "event", "channel") or splits:
            continue
        if slot.name not in SEEN_BY_THE_TREE_ONLY:
            found = judge(Case(shape, {slot.name: text}))
            assert isinstance(found, Refused), slot
            assert "bad-name" in found.rules, slot


@pytest.mark.parametrize("variable", ["ﬁ", "ª", "K", "é", "state", "_outputs", "self", "__init__"])
def test_a_variable_may_have_any_name_of_ecmascript(
    variable: str, imported: list[Accepted]
) -> None:
    accept(imported, Case(MACHINE, {"variable 0": variable, "variable 1": "fi"}))


@pytest.mark.parametrize(
    ("one", "other"), [("ﬁ", "fi"), ("ª", "a"), ("\u212a", "K"), ("é", "e\u0301"), ("a_b", "A_b")]
)
def test_variables_that_python_takes_for_one_stay_two(
    one: str, other: str, imported: list[Accepted]
) -> None:
    accept(imported, Case(MACHINE, {"variable 0": one, "variable 1": other}))


def test_a_variable_that_begins_with_a_digit_is_refused() -> None:
    assert isinstance(judge(Case(MACHINE, {"variable 0": "1a"})), Refused)


@pytest.mark.parametrize("text", ["x" * 255, "Ab" * 127, '"' * 255, "é" * 255])
def test_a_name_of_255_characters_is_accepted(text: str, imported: list[Accepted]) -> None:
    slots = ("node", "state 0", "timer", "id 0", "event 0", "publisher")
    accept(imported, *(Case(MACHINE, {slot: text}) for slot in slots))


@pytest.mark.parametrize(
    "name",
    [
        *("Signal", "Queue", "Types", "Enum", "Random", "json", "Logging", "test", "Site", "M2C"),
        *(
            "moon",
            "transports",
            "msgspec",
            "Setuptools",
            "Launch",
            "None",
            "class",
            "__init__",
            "1",
        ),
        *("Copy", "Any", "Protocol", "Outputs", "Ecmascript", "Exception", "漢字", "'", "plugins"),
    ],
)
def test_a_node_a_plugin_or_a_system_may_be_called_like_a_module(
    name: str, imported: list[Accepted]
) -> None:
    slots = ((TOPICS, "source"), (TOPICS, "folder"), (TREE, "plugin"))
    accept(imported, *(Case(shape, {slot: name}) for shape, slot in slots))


@pytest.mark.parametrize("name", ["None", "Enum", "Any", "Protocol", "Outputs", "String", "Struct"])
def test_a_type_may_be_called_like_what_generated_code_imports(
    name: str, imported: list[Accepted]
) -> None:
    slots = ((TOPICS, "message"), (TOPICS, "part"), (SERVICES, "service"), (ACTION, "action"))
    accept(imported, *(Case(shape, {slot: name}) for shape, slot in slots))


@pytest.mark.parametrize(
    "name", ["class", "import", "print", "self", "data", "copy", "fields", "id"]
)
def test_a_field_keeps_its_name_on_its_way_whatever_python_calls_it(
    name: str, imported: list[Accepted]
) -> None:
    asked = Case(SERVICES, {"request number": name, "response text": name})
    accept(imported, asked, Case(TOPICS, {"message number": name, "part number": name}))


@pytest.mark.parametrize("key", ['"', "'", "a\"b'c", "\\", "{x}", "\n", "", "a b", "__class__"])
def test_a_key_of_an_object_may_be_any_text(key: str, imported: list[Accepted]) -> None:
    accept(imported, *(Case(MACHINE, {slot: key}) for slot in ("key 0", "key 1")))


@pytest.mark.parametrize("key", ['"', "'", "a\"b'c", "\\", "{x}", '"]+__import__("os")+["'])
def test_a_key_of_a_port_may_have_quotes(key: str, imported: list[Accepted]) -> None:
    slots = ("unused port", "unused channel port")
    accept(imported, *(Case(TREE, {slot: key}) for slot in slots))


@pytest.mark.parametrize("package", ["a-b", 'a"b', "A", "a b", "../a", "1a", "a\nb", "ﬁ", "a__b"])
def test_a_package_of_interfaces_that_ros_2_does_not_allow_is_refused(package: str) -> None:
    assert isinstance(judge(Case(TOPICS, {"package": package})), Refused)


@pytest.mark.parametrize("package", ["class", "import", "json", "m2c", "transports", "zq_2"])
def test_a_package_of_interfaces_may_have_any_name_that_ros_2_allows(
    package: str, imported: list[Accepted]
) -> None:
    accept(imported, Case(TOPICS, {"package": package}))


@pytest.mark.parametrize(("one", "other"), [("a-b", "a_b"), ("A_B", "a_b"), ("'", '"'), ("é", "e")])
def test_names_that_are_one_when_made_identifiers_stay_two(
    one: str, other: str, imported: list[Accepted]
) -> None:
    pairs = (
        (TOPICS, "source", "sink"),
        (TREE, "plugin", "plugin unused"),
        (MACHINE, "state 0", "state 1"),
        (MACHINE, "event 0", "event 1"),
        (TREE, "tick channel", "halt channel"),
        (TREE, "leaf", "plugin leaf"),
        (TREE, "main tree", "sub tree"),
    )
    accept(imported, *(Case(shape, {a: one, b: other}) for shape, a, b in pairs))
