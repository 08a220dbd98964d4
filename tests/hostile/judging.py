"""What is asked of one system: refused by the check, or all that is generated from it is right."""

from __future__ import annotations

import configparser
import json
import re
import sys
import tempfile
import tomllib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from pathlib import Path, PurePosixPath

import msgspec
import pytest
from lxml import etree

from m2c.check.reading import read_and_check
from m2c.codegen import draft
from m2c.codegen.formatting import formatted
from m2c.codegen.package import system_files
from m2c.codegen.packaging import Packaging
from m2c.model import DiagnosticLog, Severity, System
from m2c.policy.program import Policy, read_policy
from tests.hostile.code import Profile, differences, profiles
from tests.hostile.models import Case, harmless_texts, slots_of
from tests.hostile.running import no_payload_runs, run
from tests.hostile.texts import MARK

SHADOWED = frozenset(sys.stdlib_module_names) | {
    *("m2c", "moon", "transports", "msgspec", "click", "lxml", "jinja2", "zenoh", "behaviortreepy"),
    *("esprima", "rosbags", "numpy", "rclpy", "launch", "launch_ros", "setuptools", "std_msgs"),
}
"""Modules that a generated package must not hide: it comes first on its node's module path."""
MAX_FILE_NAME = 255
"""NAME_MAX of POSIX, in bytes."""


class Refused(msgspec.Struct, frozen=True):
    """The check has errors: their rules; empty if the files could not even be written."""

    rules: tuple[str, ...]


class Accepted(msgspec.Struct, frozen=True):
    """The system passed the check and everything after it. ``files``: by packaging, then path."""

    case: Case
    files: dict[str, dict[str, str]]


def judge(case: Case) -> Accepted | Refused:
    """Check ``case``; if it is accepted, generate it, look at it and run it.

    Raises:
        AssertionError: what is generated is not right, or does not run as the model says.
    """
    with tempfile.TemporaryDirectory() as scratch, no_payload_runs(), formatting_once():
        folder = Path(scratch).resolve()
        path = _write(case, folder)
        if path is None:
            return Refused(())
        log = DiagnosticLog()
        system = read_and_check([path], [], log)
        rules = {item.rule for item in log.diagnostics if item.severity is Severity.ERROR}
        if system is None or rules:
            assert rules, "nothing was read, and no error says why"
            return Refused(tuple(sorted(rules)))
        generated = {}
        for packaging in Packaging:
            files = system_files(system, packaging)
            generated[packaging.value] = files
            _check_code(case, packaging, files)
            _check_paths(files)
            _check_data_files(system, files)
        _check_run(case, system)
        assert not list(folder.rglob(MARK)), "a payload ran"
        assert not Path(MARK).exists(), "a payload ran"
    return Accepted(case, generated)


_FORMATTED: dict[tuple[str, str], str] = {}
"""By name and text."""


@contextmanager
def formatting_once() -> Iterator[None]:
    """Within, files are formatted as :func:`m2c.codegen.formatting.formatted` does, each text once.

    Most of a system is the same in either packaging, and whatever one name is.
    """

    def remembered(files: Mapping[str, str]) -> dict[str, str]:
        keys = {path: (PurePosixPath(path).name, text) for path, text in files.items()}
        new = formatted({path: files[path] for path in files if keys[path] not in _FORMATTED})
        _FORMATTED.update({keys[path]: text for path, text in new.items()})
        return {path: _FORMATTED[key] for path, key in keys.items()}

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(draft, "formatted", remembered)
        yield


def _write(case: Case, folder: Path) -> Path | None:
    """Write the case's files below ``folder``; None if no file can hold them."""
    try:
        files = case.files()
        paths = {(folder / name).resolve(): content for name, content in files.items()}
        if not all(path.is_relative_to(folder) for path in paths) or len(paths) < len(files):
            return None
        for path, content in paths.items():
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
    except (ValueError, OSError):  # not XML, not UTF-8, or no name of a file
        return None
    return next(iter(paths))


class Twin(msgspec.Struct, frozen=True):
    """What the generator makes of the shape of a case: its profiles, by role."""

    profiles: dict[str, Profile]


@cache
def twin_of(shape: tuple[str, ...], packaging: Packaging) -> Twin:
    """The profiles of the harmless system of ``shape``, which the check must accept."""
    with tempfile.TemporaryDirectory() as scratch:
        path = _write(Case(shape, {}), Path(scratch).resolve())
        assert path is not None
        log = DiagnosticLog()
        system = read_and_check([path], [], log)
        assert system is not None
        assert not log.has_errors, log.diagnostics
        return Twin(profiles(system_files(system, packaging)))


def _check_code(case: Case, packaging: Packaging, files: Mapping[str, str]) -> None:
    twin = twin_of(case.shape, packaging).profiles
    found = profiles(files, twin)
    different = differences(found, twin)
    assert not different, "the code differs from its twin's: " + "; ".join(different)
    for role, expected in twin.items():
        if role.endswith((":machine.py", ":node.py", ":interfaces.py")):
            missing = set(_expected_texts(case, expected)) - found[role].constants
            assert not missing, f"{role}: lost texts {missing!r}"


_ATTRIBUTES = ("channel", "event", "label", "name", "port")
"""Kinds of slots whose whole text is an attribute's value."""

_SLOT_TEXT = re.compile(r"(/?)(zq\d+)")


def _expected_texts(case: Case, twin: Profile) -> Iterator[str]:
    """The texts that must be constants, as their harmless twins are."""
    by_text = {text: name for name, text in harmless_texts(case.shape).items()}
    kinds = {slot.name: slot.kind for slot in slots_of(case.shape)}
    for constant in twin.constants:
        match = _SLOT_TEXT.fullmatch(constant) if isinstance(constant, str) else None
        if match is None or match[2] not in by_text:
            continue
        slot = by_text[match[2]]
        if kinds[slot] == "variable":  # an identifier, which may be written in quotes, too
            continue
        text = case.text(slot)
        if kinds[slot] in _ATTRIBUTES:  # the reader takes blanks around them away
            text = text.strip()
            if not text:
                continue
        yield text if text.startswith("/") and kinds[slot] == "channel" else match[1] + text


def _check_paths(files: Mapping[str, str]) -> None:
    for name in files:
        path = PurePosixPath(name)
        assert not path.is_absolute(), name
        assert str(path) == name, f"not a plain path: {name!r}"
        for part in path.parts:
            assert part not in ("..", "."), name
            assert re.fullmatch(r"[\w.-]+", part, re.ASCII), f"a file called {part!r}"
            assert len(part.encode()) <= MAX_FILE_NAME, f"{len(part)} characters: {part!r}"
    folded = [name.casefold() for name in files]
    assert len(set(folded)) == len(folded), "two files are one where case does not count"


def _check_data_files(system: System, files: Mapping[str, str]) -> None:
    launch = json.loads(files["launch.json"])
    assert launch["system"] == system.name
    nodes = {item["package"]: item["name"] for item in launch["nodes"]}
    assert list(nodes.values()) == [node.name for node in system.nodes], launch
    if launch["policy"] is not None:
        package = launch["policy"]["package"]
        nodes[package] = system.name
        _check_policy(system, files[f"{package}/{package}/policy.json"])
    for package in nodes:
        assert package not in SHADOWED, f"the package `{package}` hides a module"
    for name, content in files.items():
        package = PurePosixPath(name).parts[0]
        shown = nodes.get(package, system.name)
        match PurePosixPath(name).name:
            case "pyproject.toml":
                project = tomllib.loads(content)["project"]
                assert re.fullmatch(r"[a-z0-9]([a-z0-9._-]*[a-z0-9])?", project["name"]), project
                _check_shown(project["description"], shown)
            case "package.xml":
                root = etree.fromstring(content.encode())
                assert root.findtext("name") == package, content
                _check_shown(root.findtext("description") or "", shown)
                comments = [item.text or "" for item in root.iter(etree.Comment)]
                assert MARK not in "".join(comments)
                assert {item.tag for item in root.iter("*")} <= _PACKAGE_XML, content
            case "setup.cfg":
                parser = configparser.ConfigParser()
                parser.read_string(content)
                values = [dict(parser[section]) for section in parser.sections()]
                assert MARK not in repr(values)


_PACKAGE_XML = {
    *(
        "package",
        "name",
        "version",
        "description",
        "maintainer",
        "license",
        "exec_depend",
        "depend",
    ),
    *(
        "export",
        "build_type",
        "author",
        "url",
        "buildtool_depend",
        "member_of_group",
        "test_depend",
    ),
}
"""The elements of package format 3 (REP 149) that a generated package may have."""


def _check_shown(described: str, name: str) -> None:
    """A description has the name, or its beginning if it is long."""
    blanks = " ".join(name.split())
    assert "\n" not in described, f"more than one line: {described!r}"
    assert (
        name in described or blanks in described or (blanks[:20] in described and "…" in described)
    ), f"{described!r} does not show {name!r}"


def _check_policy(system: System, content: str) -> None:
    assert system.policy is not None
    policy = msgspec.json.decode(content, type=Policy)
    assert policy == read_policy(system.policy, system, DiagnosticLog())


def _check_run(case: Case, system: System) -> None:
    ran = run(system)
    assert ran.observations > 5, "next to nothing was observed"
    assert not ran.violations, [str(item) for item in ran.violations]
    assert not ran.faults, ran.faults
    if "machine" in case.shape:
        label = case.text("label 0").strip()
        text = f"{label}: {case.text('literal 2')}" if label else case.text("literal 2")
        assert text in ran.logged, f"{text!r} was not logged"
