"""Who may not is refused, by peers and by a router, and the system goes on."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.keys.intruder import Attempt
from tests.keys.secured import Intruder, Secured, secured_folder, with_foreign_certificate

pytestmark = pytest.mark.zenoh


@pytest.fixture(scope="module", params=["mesh", "router"])
def secured(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Secured]:
    folder = secured_folder(tmp_path_factory.mktemp("keys"))
    with contextlib.closing(Secured(folder, request.param == "router")) as running:
        yield running


def attempt(secured: Secured, folder: Path, name: str) -> Attempt:
    return Attempt(folder=str(folder), name=name, endpoint=secured.endpoint, mode=secured.mode)


@pytest.mark.parametrize("name", ["observer", "Other", "several"])
def test_who_has_a_certificate_sends_and_hears_only_what_its_rights_say(
    secured: Secured, name: str, caplog: pytest.LogCaptureFixture
) -> None:
    with contextlib.closing(Intruder(attempt(secured, secured.folder, name))) as intruder:
        assert intruder.said() == {"opened": True, "fence": True}
        secured.works()
        assert intruder.end() == {"replies": [], "asked": [], "secret": name == "observer"}
    secured.works()
    assert set(secured.levels) == {7}
    assert set(secured.requests) == {"Sensor"}
    assert {node for node, _ in secured.up} == {"Skill", "Sensor"}
    assert {heard.source for heard in secured.observed} == {"Skill", "Sensor"}
    channels = {heard.channel for heard in secured.observed}
    assert channels == {"/level", "/done", "/secret", "/Skill/tick", "/absent", "/map"}
    assert not caplog.records


@pytest.mark.parametrize("who", ["without a certificate", "expired", "of another authority"])
def test_who_has_no_good_certificate_is_linked_to_nobody(
    secured: Secured, who: str, tmp_path: Path
) -> None:
    folder, name = secured.folder, ""
    if who != "without a certificate":
        name = "Other"
        folder = with_foreign_certificate(
            secured.folder, tmp_path / "foreign", name, expired=who == "expired"
        )
    with contextlib.closing(Intruder(attempt(secured, folder, name))) as intruder:
        assert intruder.said()["opened"] is False
    secured.works()
    assert set(secured.levels) == {7}
