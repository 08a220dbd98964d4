"""The net itself: what it must catch, put into code that is right."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from m2c.codegen.formatting import formatted
from m2c.codegen.packaging import Packaging
from tests.hostile.code import differences, profiles
from tests.hostile.importing import import_all
from tests.hostile.judging import Accepted, judge
from tests.hostile.models import Case

TWIN = {
    "zq1/zq1/machine.py": (
        "import copy\n\n\nclass Zq1:\n    def on_zq2(self, name):\n"
        '        self.zq3 = copy.copy(name) if name == "zq2" else str(name)\n'
    )
}
HONEST = TWIN["zq1/zq1/machine.py"].replace("zq1", "a").replace("Zq1", "print").replace("zq3", "os")


def found(text: str) -> list[str]:
    twin = profiles(TWIN)
    return differences(profiles({"a/a/machine.py": text}, twin), twin)


def test_code_that_differs_in_names_of_the_model_only_is_the_twin_s() -> None:
    assert found(HONEST) == []


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("copy.copy(name)", "copy.copy(name).x()"),
        ("copy.copy(name)", "copy.deepcopy(name)"),
        ("str(name)", "eval(name)"),
        ("import copy", "import os as copy"),
        ("self.os =", "self.os = self.x ="),
        ("def on_zq2(self, name):", "def on_zq2(self, name=print):"),
        ('"zq2"', '"zq2" + "x"'),
    ],
)
def test_code_that_says_more_or_something_else_is_found(old: str, new: str) -> None:
    assert found(HONEST.replace(old, new, 1))


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        ("str(name)", "PWNED(name)", "nothing binds `PWNED`"),
        ("import copy", "import copy  # PWNED", "a payload in the comment"),
        ("self.os", "self.é", "the identifier"),
        ('"zq2"', '"\\N{x}"', "does not compile"),
        ('"zq2"', '"\\p"', "does not compile"),
    ],
)
def test_code_that_cannot_be_is_refused(old: str, new: str, why: str) -> None:
    with pytest.raises(AssertionError, match=why):
        found(HONEST.replace(old, new, 1))


def test_a_package_that_cannot_be_imported_is_named_with_its_system(tmp_path: Path) -> None:
    right = judge(Case(("topics",), {}))
    assert isinstance(right, Accepted)
    files = dict(right.files[Packaging.WHEEL])
    name = next(name for name in files if name.endswith("/node.py"))
    files[name] += "import signal.nothing\n"
    wrong = msgspec.structs.replace(right, files={Packaging.WHEEL: files})
    with pytest.raises(AssertionError, match=r"(?s)Case\(.*cannot be imported.*signal.nothing"):
        import_all([right, wrong], tmp_path)


def test_a_file_is_formatted_the_same_whatever_is_formatted_with_it() -> None:
    """On which :func:`tests.hostile.judging.formatting_once` relies."""
    right = judge(Case(("topics", "tree"), {}))
    assert isinstance(right, Accepted)
    files = {
        name: text.replace("\n\n", "\n").replace("import", "import  ")
        for name, text in right.files[Packaging.AMENT].items()
    }
    alone = {name: formatted({name: text})[name] for name, text in files.items()}
    assert alone == formatted(files) != files
