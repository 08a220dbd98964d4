"""``moon keys``, and what is said of a folder with which nothing can be run."""

from __future__ import annotations

import errno
import logging
import os
import shutil
import stat
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from cryptography import x509

from moon.cli import main
from moon.keys.folder import make
from tests.keys.secured import NODES, PROCESSES, number, secured_folder, with_foreign_certificate
from tests.launch.system import System
from tests.monitor.processes import free_endpoint
from tests.transports.zenoh_network import Inbox, peer
from transports.interface import TransportError
from transports.networks import spinning
from transports.zenoh import connect
from transports.zenoh_link.credentials import check, configuration_file


def run(*words: object) -> Result:
    return CliRunner().invoke(main, [str(word) for word in ("keys", *words)])


def serial(file: Path) -> int:
    return x509.load_pem_x509_certificate(file.read_bytes()).serial_number


def test_init_makes_certificates_and_keys_that_only_their_user_can_read(tmp_path: Path) -> None:
    system, keys = System(tmp_path / "lab"), tmp_path / "keys"
    result = run("init", keys, system.path)
    assert result.exit_code == 0, result.output
    assert "certificates for LevelSkill, MoveSkill, policy, m2c_run, monitor, observer, router" in (
        result.output
    )
    assert "they expire on " in result.output
    for name in ("LevelSkill", "policy", "observer"):
        check(keys, name)
    private = list(keys.glob("*.key"))
    assert len(private) == 8
    assert {stat.S_IMODE(file.stat().st_mode) for file in private} == {0o600}


def test_renew_makes_new_certificates_of_the_same_authority(tmp_path: Path) -> None:
    system, keys = System(tmp_path / "lab"), tmp_path / "keys"
    run("init", keys, system.path, "--days", 1)
    before = serial(keys / "policy.pem"), serial(keys / "ca.pem")
    result = run("renew", keys, system.path)
    assert result.exit_code == 0, result.output
    assert serial(keys / "policy.pem") != before[0]
    assert serial(keys / "ca.pem") == before[1]
    check(keys, "policy")


def test_init_writes_over_nothing_and_renew_needs_an_authority(tmp_path: Path) -> None:
    system, keys = System(tmp_path / "lab"), tmp_path / "keys"
    keys.mkdir()
    (keys / "mine").touch()
    for words, why in (
        (("init", keys, system.path), "is not empty"),
        (("init", keys / "mine", system.path), "not a folder"),
        (("init", tmp_path / "new", tmp_path / "nothing.xml"), "no such file"),
        (("renew", keys, system.path), "`moon keys init` makes an authority"),
    ):
        result = run(*words)
        assert result.exit_code == 2
        assert why in result.output
        assert "Traceback" not in result.output
    assert not (tmp_path / "new").exists()


def remove(folder: Path) -> None:
    shutil.rmtree(folder)


def another_name(folder: Path) -> None:
    shutil.copy(folder / "Other.pem", folder / "Skill.pem")


def another_key(folder: Path) -> None:
    shutil.copy(folder / "Other.key", folder / "Skill.key")


def a_folder_as_key(folder: Path) -> None:
    (folder / "Skill.key").unlink()
    (folder / "Skill.key").mkdir()


def no_certificate(folder: Path) -> None:
    (folder / "Skill.pem").unlink()


def expired(folder: Path) -> None:
    made = with_foreign_certificate(folder, folder.with_name("expired"), "Skill", expired=True)
    for name in ("Skill.pem", "Skill.key"):
        shutil.copy(made / name, folder / name)


def foreign(folder: Path) -> None:
    made = with_foreign_certificate(folder, folder.with_name("foreign"), "Skill", expired=False)
    for name in ("Skill.pem", "Skill.key"):
        shutil.copy(made / name, folder / name)


def junk(folder: Path) -> None:
    (folder / "Skill.pem").write_text("junk")


@pytest.mark.parametrize(
    ("spoil", "why"),
    [
        (remove, "does not exist: no certificates; `moon keys init` makes one"),
        (no_certificate, "has no certificate of Skill; it has those of Other, Sensor"),
        (another_name, "a certificate for another name, Other instead of Skill"),
        (another_key, "not the key of the certificate beside it"),
        (a_folder_as_key, "cannot be read: Is a directory"),
        (expired, "the certificate of Skill expired on "),
        (foreign, "not issued by the authority in "),
        (junk, "not a certificate"),
    ],
)
def test_a_process_is_not_started_with_what_is_not_its_own_good_certificate(
    tmp_path: Path, spoil: Callable[[Path], None], why: str
) -> None:
    keys = secured_folder(tmp_path / "keys")
    spoil(keys)
    with pytest.raises(TransportError, match=why):
        connect("Skill", {"secure": str(keys), "listen": free_endpoint().replace("tcp", "tls")})


@pytest.mark.skipif(os.geteuid() == 0, reason="root can read everything")
def test_a_key_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    keys = secured_folder(tmp_path / "keys")
    (keys / "Skill.key").chmod(0)
    with pytest.raises(TransportError, match=r"Skill\.key: cannot be read: Permission denied"):
        check(keys, "Skill")


def test_what_expires_soon_and_what_others_can_read_is_warned_of(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    keys = tmp_path / "keys"
    make(keys, "test", PROCESSES, days=29)
    (keys / "Skill.key").chmod(0o644)
    with caplog.at_level(logging.WARNING):
        configuration_file(keys, "Skill")
    first, second = caplog.messages
    assert "the certificate of Skill expires on " in first
    assert "in 28 days" in first
    assert "Skill.key can be read by others: chmod 600" in second


@pytest.mark.zenoh
def test_a_folder_may_be_moved_and_is_for_one_namespace(tmp_path: Path) -> None:
    make(tmp_path / "made", "test", NODES, days=100, namespace="robot1")
    keys = (tmp_path / "made").rename(tmp_path / "keys")
    options = {"secure": str(keys), "rendezvous": free_endpoint().replace("tcp", "tls")}
    with pytest.raises(TransportError, match=r"certificates in .* are for another one"):
        connect("Skill", {**options, "namespace": "robot2"})
    skill, sensor = (connect(name, options) for name in ("Skill", "Sensor"))
    with spinning(skill, sensor):
        heard = Inbox()
        skill.subscribe(number("/level"), heard)
        skill.announce()
        assert sensor.wait_for_nodes(["Skill"], 20.0) == []
        level = sensor.publisher(number("/level"))
        sensor.every(0.05, lambda: level.publish(peer.Number(3)))
        assert heard.wait()[0] == peer.Number(3)


NAMESPACES = [
    *(
        "robots/*",
        "**",
        "a//b",
        "#",
        "a\nb",
        "a$*b",
        "?",
        "/robot1",
        "robot1/",
        "/",
        "@m2c",
        "a/@b",
    ),
    *(" ", "a/ b", "a\x1b[31m", "x" * 300),
]


@pytest.mark.parametrize("namespace", NAMESPACES)
@pytest.mark.parametrize("command", ["init", "renew"])
def test_a_namespace_that_is_no_plain_path_of_chunks_is_refused_before_anything_is_written(
    tmp_path: Path, command: str, namespace: str
) -> None:
    system, keys = System(tmp_path / "lab"), tmp_path / "keys"
    result = run(command, keys, system.path, "--namespace", namespace)
    assert result.exit_code == 2
    assert result.exception is None or isinstance(result.exception, SystemExit)
    (line,) = result.output.splitlines()
    assert line.startswith("error: --namespace: namespace ")
    assert "e.g. robots/7" in line
    assert not keys.exists()


@pytest.mark.zenoh
@pytest.mark.parametrize("namespace", NAMESPACES)
def test_nobody_connects_with_a_namespace_that_is_none(namespace: str) -> None:
    with pytest.raises(TransportError, match="namespace ") as found:
        connect("node", {"namespace": namespace})
    assert len(str(found.value)) < 1000


def named(folder: Path, name: str, system: str = "lab") -> Path:
    """The system of two skills; one of them, and the system, have other names."""
    made = System(folder)
    skill = folder / "LevelSkill.scxml"
    skill.write_text(skill.read_text().replace('name="LevelSkill"', f'name="{name}"'))
    return made.path.rename(folder / f"{system}.xml")


@pytest.mark.parametrize("name", ["x" * 64, "ä" * 32, "robot 1", "a.b", "日本" * 10])
def test_every_name_that_a_certificate_can_have_gets_one(tmp_path: Path, name: str) -> None:
    keys = tmp_path / "keys"
    result = run("init", keys, named(tmp_path / "lab", name))
    assert result.exit_code == 0, result.output
    check(keys, name)


@pytest.mark.parametrize("name", ["x" * 65, "ä" * 33, "x" * 255, "日本" * 11, ".hidden", "a/b"])
def test_a_name_that_no_certificate_can_have_is_refused_before_anything_is_written(
    tmp_path: Path, name: str
) -> None:
    keys = tmp_path / "keys"
    result = run("init", keys, named(tmp_path / "lab", name))
    assert result.exit_code == 2
    assert "Traceback" not in result.output
    assert "at most 64 bytes" in result.output
    assert not keys.exists()


@pytest.mark.parametrize("system", ["s" * 51, "s" * 200, "ü" * 60])
def test_the_system_may_have_any_name(tmp_path: Path, system: str) -> None:
    keys = tmp_path / "keys"
    result = run("init", keys, named(tmp_path / "lab", "LevelSkill", system))
    assert result.exit_code == 0, result.output
    check(keys, "LevelSkill")


@pytest.mark.parametrize("there", [True, False])
def test_what_cannot_be_written_whole_is_not_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, there: bool
) -> None:
    system, keys = System(tmp_path / "lab"), tmp_path / "a" / "keys"
    if there:
        keys.mkdir(parents=True)
    opened = os.open

    def full(path: Path, flags: int, mode: int = 0o777, **rest: int) -> int:
        if str(path).endswith("monitor.pem"):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))
        return opened(path, flags, mode, **rest)

    monkeypatch.setattr("moon.keys.folder.os.open", full)
    result = run("init", keys, system.path)
    assert result.exit_code == 2
    assert "No space left on device" in result.output
    assert keys.exists() == there
    assert (tmp_path / "a").exists() == there
    assert not there or not any(keys.iterdir())
