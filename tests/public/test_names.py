"""What ``import m2c``, ``import moon`` and ``import transports`` offer, and what they cost."""

from __future__ import annotations

import importlib
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = ("m2c", "moon", "transports")
HEAVY = {"click", "lxml", "mcap", "msgspec", "rich", "zenoh"}


def in_a_fresh_process(code: str) -> str:
    ran = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(code)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
        timeout=120,
    )
    return ran.stdout.strip()


@pytest.mark.parametrize("package", PACKAGES)
def test_every_name_in_all_is_there_and_is_shown_by_dir(package: str) -> None:
    module = importlib.import_module(package)
    assert len(set(module.__all__)) == len(module.__all__)
    for name in module.__all__:
        assert getattr(module, name) is not None
        assert name in dir(module)


@pytest.mark.parametrize("package", PACKAGES)
def test_a_name_that_is_not_offered_is_an_attribute_error(package: str) -> None:
    with pytest.raises(AttributeError, match=f"module '{package}' has no attribute 'nonsense'"):
        importlib.import_module(package).nonsense  # noqa: B018


@pytest.mark.parametrize("package", PACKAGES)
def test_an_import_alone_imports_nothing_heavy(package: str) -> None:
    found = in_a_fresh_process(
        f"import sys, {package}; print(*sorted({HEAVY!r} & set(sys.modules)))"
    )
    assert found == ""


def test_m2c_check_is_the_function_whatever_was_imported_before_and_after() -> None:
    """A package has the same name; importing a package binds it in the package around it."""
    for code in (
        "from m2c.check.reading import read_and_check; import m2c",
        "import m2c, m2c.check.reading",
        "import m2c; from m2c.check import check_system; from m2c.check.command import check",
        "import moon.monitor.reading, m2c",
    ):
        assert in_a_fresh_process(f"{code}\nprint(type(m2c.check).__name__)") == "function", code


@pytest.mark.slow
def test_mypy_knows_the_types_of_the_interface(tmp_path: Path) -> None:
    program = tmp_path / "program.py"
    program.write_text(
        textwrap.dedent(
            """\
            from m2c import Diagnostic, System, check, generate, read_system, simulate
            from moon import Monitor, Oracle, PropertySet, Recording, Verdict, check_recording
            from transports import Observation, SimulatedWorld, Transport, connect

            system = read_system("system.xml")
            reveal_type(system)
            reveal_type(check(system))
            reveal_type(generate(system, "folder", transport="ros2"))
            machine = system.node("Level")
            assert machine is not None
            reveal_type(Oracle(machine))
            properties = PropertySet.from_text("properties: []", system=system)
            reveal_type(properties)
            world = SimulatedWorld(seed=1)
            simulate(system, world).run(1.0)
            reveal_type(Monitor(world.connect("monitor"), system, properties).violations)
            reveal_type(check_recording("run.mcap", system).violated[0].verdict)
            reveal_type(Recording.open("run.mcap"))
            reveal_type(connect("zenoh", "node", {}))
            check("system.xml")
            """
        )
    )
    ran = subprocess.run(
        [sys.executable, "-m", "mypy", "--strict", "--no-error-summary", str(program)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
        timeout=240,
    )
    revealed = [line.partition('type is "')[2].rstrip('"') for line in ran.stdout.splitlines()]
    assert [kind for kind in revealed if kind] == [
        "m2c.model.system.System",
        "list[m2c.diagnostics.Diagnostic]",
        "list[pathlib.Path]",
        "moon.oracle.oracle.Oracle",
        "moon.properties.monitor.PropertySet",
        "int",
        "moon.verdict.Verdict",
        "moon.recording.reader.Recording",
        "transports.interface.Connection",
    ], ran.stdout + ran.stderr
    errors = [line for line in ran.stdout.splitlines() if " error: " in line]
    assert len(errors) == 1
    assert 'Argument 1 to "check" has incompatible type "str"; expected "System"' in errors[0]


@pytest.mark.parametrize("package", PACKAGES)
def test_a_package_says_that_it_is_typed(package: str) -> None:
    assert (ROOT / package / "py.typed").exists()
