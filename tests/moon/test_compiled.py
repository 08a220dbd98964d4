"""Compiled modules run only while they are what is written."""

from __future__ import annotations

import importlib.machinery
import os
import runpy
import subprocess
import sys
from pathlib import Path

import pytest

import moon

ROOT = Path(__file__).parents[2]
SUFFIX = importlib.machinery.EXTENSION_SUFFIXES[-1]


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """A clone with one compiled module."""
    (tmp_path / "setup.py").touch()
    package = tmp_path / "moon"
    (package / "oracle").mkdir(parents=True)
    for name in (f"compiled__mypyc{SUFFIX}", f"oracle/search{SUFFIX}", "oracle/search.py"):
        (package / name).touch()
        os.utime(package / name, ns=(10**18, 10**18))
    return package


def test_a_module_changed_after_it_was_compiled_is_refused(package: Path) -> None:
    moon._refuse_stale(package)
    os.utime(package / "oracle/search.py", ns=(10**18 + 1, 10**18 + 1))
    with pytest.raises(ImportError, match=r"search\.py was changed .* `make compiled`"):
        moon._refuse_stale(package)


def test_a_module_beside_the_library_is_refused_as_well(package: Path) -> None:
    """As transports/cdr.py is."""
    (package / f"cdr{SUFFIX}").touch()
    (package / "cdr.py").touch()
    os.utime(package / "cdr.py", ns=(10**18, 10**18))
    moon._refuse_stale(package)
    os.utime(package / "cdr.py", ns=(10**18 + 1, 10**18 + 1))
    with pytest.raises(ImportError, match=r"cdr\.py was changed"):
        moon._refuse_stale(package)


def test_every_compiled_file_is_of_one_library(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    monkeypatch.delenv("MOON_COMPILED", raising=False)
    monkeypatch.setattr("setuptools.setup", lambda **_: None)
    setup = runpy.run_path("setup.py")
    files = setup["modules"]()
    assert {Path(file).parts[0] for file in files} == set(setup["GROUPS"])
    assert "transports/cdr.py" in files
    assert "moon/recording/cdr.py" in files


def test_a_module_that_was_never_compiled_may_change(package: Path) -> None:
    (package / "oracle/explain.py").touch()
    moon._refuse_stale(package)


def test_the_interpreted_form_is_there_beside_the_compiled_one() -> None:
    """What ``make unit-interpreted`` relies on."""
    shown = "import tests.interpreted, moon.oracle.search as s; print(s.__file__)"
    ran = subprocess.run(
        [sys.executable, "-c", shown], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert ran.stdout.strip() == str(ROOT / "moon/oracle/search.py")
