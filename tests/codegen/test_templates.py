"""``m2c generate --templates``: a user's own templates, and what becomes of those that cannot be used."""

from __future__ import annotations

import ast
import os
import re
from pathlib import Path

import msgspec
import pytest
from click.testing import CliRunner, Result

from m2c.codegen import program
from m2c.codegen.command import generate
from m2c.codegen.rendering import TemplateFault, Templates
from m2c.codegen.source import FILTERS, PlainTextError, Source, doc, name, py, toml, xml

ROOT = Path(__file__).parents[2]

MODEL = ROOT / "examples" / "lab_tour" / "skills" / "BatteryLevelSkill.scxml"
SYSTEM = ROOT / "examples" / "lab_tour" / "system.xml"
PAGE = ROOT / "docs" / "templates.md"
OURS = ROOT / "m2c" / "codegen" / "templates"


def run(folder: Path, *options: str, model: Path = MODEL, **templates: str) -> Result:
    """``m2c generate`` with these templates, ``node_py`` standing for ``node.py.j2``."""
    own = folder / "templates"
    own.mkdir(exist_ok=True)
    for key, text in templates.items():
        (own / f"{key.replace('_py', '.py')}.j2").write_text(text)
    arguments = [str(model), "-o", str(folder / "out"), "--templates", str(own), *options]
    return CliRunner().invoke(generate, arguments)


def refused(folder: Path, template: str) -> str:
    """What is said of ``template`` in the place of ``node.py.j2``; nothing was written."""
    done = run(folder, node_py=template)
    assert done.exit_code == 2, done.output
    assert not (folder / "out").exists()
    assert done.stderr.count("\n") == 1
    return done.stderr.removeprefix(f"error: {folder}/templates/").rstrip("\n")


def test_a_companys_header_is_one_template(tmp_path: Path) -> None:
    done = run(tmp_path, header="# Copyright: ours. Context {{ context_version }}.\n")
    assert done.exit_code == 0, done.output
    found = [path for path in (tmp_path / "out").rglob("*") if path.suffix in (".py", ".toml")]
    assert len(found) == 6
    for path in found:
        assert "\n\n# Copyright: ours. Context 1.\n" in path.read_text(), path


def test_a_template_extends_ours_by_blocks(tmp_path: Path) -> None:
    node = """{% extends "m2c/node.py.j2" %}
{% block imports %}{{ super() }}
from company.base import Base, Unused
{% endblock %}
{% block node_bases %}(Base){% endblock %}
{% block constructed %}
        self.announce({{ node.name | py }})
{% endblock %}
"""
    machine = """{% extends "m2c/machine.py.j2" %}
{% block members %}

    def count(self) -> int:
        return {{ machine.states | length }}
{% endblock %}
"""
    done = run(tmp_path, node_py=node, machine_py=machine)
    assert done.exit_code == 0, done.output
    folder = tmp_path / "out" / "battery_level_skill" / "battery_level_skill"
    text = (folder / "node.py").read_text()
    assert "from company.base import Base\n" in text
    assert "class BatteryLevelSkillNode(Base):\n" in text
    assert '        self.announce("BatteryLevelSkill")\n' in text
    assert "    def count(self) -> int:\n        return 2\n" in (folder / "machine.py").read_text()


def test_a_template_of_the_same_name_takes_the_place_of_ours(tmp_path: Path) -> None:
    done = run(tmp_path, node_init_py="", node_init='VERSION = "{{ context_version }}"\n')
    assert done.exit_code == 0
    assert "warning" in done.stderr
    (tmp_path / "templates" / "node_init.py.j2").write_text("VERSION = {{ context_version }}\n")
    assert run(tmp_path).exit_code == 0
    init = tmp_path / "out" / "battery_level_skill" / "battery_level_skill" / "__init__.py"
    assert init.read_text().endswith("\nVERSION = 1\n")


def test_a_template_that_makes_nothing_is_said(tmp_path: Path) -> None:
    done = run(tmp_path, nodes_py="x", company="# c\n", header="{% include 'company.j2' %}")
    assert done.exit_code == 0
    assert done.stderr.startswith(f"warning: {tmp_path}/templates/nodes.py.j2: makes no file; ours")
    assert done.stderr.count("\n") == 1


@pytest.mark.parametrize(
    ("template", "said"),
    [
        ("\n{% if %}", "node.py.j2:2: for `BatteryLevelSkill`: Expected an expression"),
        (
            "\n\n{{ node.nme | py }}",
            "node.py.j2:3: for `BatteryLevelSkill`: 'm2c.codegen.program.NodeProgram object' has no attribute 'nme'",
        ),
        ("{{ nodes }}", "node.py.j2:1: for `BatteryLevelSkill`: 'nodes' is undefined"),
        (
            "{{ node.name }}",
            "node.py.j2:1: for `BatteryLevelSkill`: 'BatteryLevelSkill' is text of the model",
        ),
        (
            "{{ 'a' ~ node.name }}",
            "node.py.j2:1: for `BatteryLevelSkill`: 'aBatteryLevelSkill' is text",
        ),
        (
            "{{ [node.name] | join }}",
            "node.py.j2:1: for `BatteryLevelSkill`: 'BatteryLevelSkill' is text",
        ),
        (
            "{{ node.name | name + node.name }}",
            "node.py.j2:1: for `BatteryLevelSkill`: 'BatteryLevelSkill' is text",
        ),
        (
            "{% include 'no.j2' %}",
            "node.py.j2:1: for `BatteryLevelSkill`: there is no template `no.j2`",
        ),
        (
            "x = 1\ndef (\n",
            "node.py.j2: for `BatteryLevelSkill`: makes no Python, invalid syntax in line 2: def (",
        ),
        ("{{ 1 / 0 }}", "node.py.j2:1: for `BatteryLevelSkill`: division by zero"),
        ("{{ node.name.__class__ }}", "node.py.j2:1: for `BatteryLevelSkill`: access to attribute"),
        ("{% include 'node.py.j2' %}", "node.py.j2: for `BatteryLevelSkill`: is nested too deep"),
        (
            "{% macro a() %}{{ a() }}{% endmacro %}{{ a() }}",
            "node.py.j2: for `BatteryLevelSkill`: is nested too deep",
        ),
        (
            "{% for i in range(10**9) %}{% endfor %}",
            "node.py.j2:1: for `BatteryLevelSkill`: Range too big",
        ),
    ],
)
def test_a_template_that_cannot_be_used_is_one_line_and_nothing_is_written(
    template: str, said: str, tmp_path: Path
) -> None:
    assert refused(tmp_path, template).startswith(said)


def test_a_template_that_is_no_text_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "templates").mkdir()
    (tmp_path / "templates" / "node.py.j2").write_bytes(b"\xff\xfe\x00")
    done = run(tmp_path)
    assert done.exit_code == 2
    assert done.stderr.startswith(
        f"error: {tmp_path}/templates/node.py.j2: for `BatteryLevelSkill`"
    )
    assert done.stderr.count("\n") == 1


@pytest.mark.parametrize("what", ["loop", "device", "pipe", "folder", "large"])
def test_a_template_that_is_no_file_to_be_read_is_one_line(what: str, tmp_path: Path) -> None:
    path = tmp_path / "templates" / "node.py.j2"
    path.parent.mkdir()
    match what:
        case "loop":
            path.symlink_to(path)
        case "device":
            path.symlink_to("/dev/zero")
        case "pipe":
            os.mkfifo(path)
        case "folder":
            path.mkdir()
        case "large":
            path.write_text("x" * (1024 * 1024 + 1))
    done = run(tmp_path)
    assert done.exit_code == 2
    assert done.stderr.count("\n") == 1
    assert "node.py.j2: for `BatteryLevelSkill`" in done.stderr
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("made", ["file", "nothing", "everything"])
def test_a_folder_of_templates_that_is_none_is_one_error(made: str, tmp_path: Path) -> None:
    place = Path("/") if made == "everything" else tmp_path / "templates"
    if made == "file":
        place.write_text("")
    arguments = [str(MODEL), "-o", str(tmp_path / "out"), "--templates", str(place)]
    done = CliRunner().invoke(generate, arguments)
    assert done.exit_code == 2
    assert (
        "--templates" if made != "everything" else "error: /: no folder of templates"
    ) in done.stderr
    assert not (tmp_path / "out").exists()


def test_a_templates_own_code_is_not_run(tmp_path: Path) -> None:
    attack = "{{ ''.__class__.__mro__[1].__subclasses__() }}"
    assert "unsafe" in refused(tmp_path, attack)
    attack = "{{ self.__init__.__globals__ }}"
    assert "unsafe" in refused(tmp_path, attack) or "undefined" in refused(tmp_path, attack)


# -- what may be printed ---------------------------------------------------------------------------

HOSTILE = [
    '"""',
    "'''",
    "\\",
    'a"b',
    "a'b",
    "\n",
    "\r\n",
    "\x00",
    "\x1b[2J",
    "\u202e",
    "\u2028",
    "{{ x }}",
    "{% x %}",
    "\\N{x}",
    "</script>",
    "]]>",
    "&amp;",
    "<a>",
    "\x7f",
    "\U0001f600",
    "ﬁ",
    "é",
    "#",
    "$HOME",
]


@pytest.mark.parametrize("text", HOSTILE)
def test_every_filter_makes_one_literal_of_whatever_text(text: str) -> None:
    import tomllib

    from m2c.diagnostics import DiagnosticLog
    from m2c.model.xml import parse_xml

    assert ast.literal_eval(py(text)) == text
    assert "\n" not in py(text)
    (statement,) = ast.parse(f'"""A ``{doc(text)}``."""').body
    assert isinstance(statement, ast.Expr)
    assert isinstance(statement.value, ast.Constant)
    assert str(statement.value.value).isprintable()
    assert tomllib.loads(f"a = {toml(text)}")["a"] == text
    log = DiagnosticLog()
    read = parse_xml(f'<a b="{xml(text)}">{xml(text)}</a>'.encode(), "a.xml", log)
    assert read is not None, log.diagnostics
    allowed = re.sub("[\x00-\x08\x0b-\x1f]", "\ufffd", text.replace("\r\n", "\n"))
    assert read.text == allowed


@pytest.mark.parametrize("text", ["", "a b", "1a", "a-b", "ﬁ", "a.", "a;b", "a\n"])
def test_no_other_text_is_a_name(text: str) -> None:
    with pytest.raises(ValueError, match="no name"):
        name(text)


def test_source_takes_no_plain_text() -> None:
    assert Source("a") + py("b") == 'a"b"'
    for wrong in (
        lambda: Source("a") + "b",
        lambda: "a" + Source("b"),
        lambda: Source("{}").format("b"),
    ):
        with pytest.raises(PlainTextError):
            wrong()


def test_our_templates_print_nothing_unchecked() -> None:
    for path in OURS.glob("*.j2"):
        text = path.read_text()
        assert "|safe" not in text.replace(" ", ""), path
        assert "autoescape" not in text, path


def test_a_template_cannot_print_plain_text_by_any_of_jinjas_own_filters(tmp_path: Path) -> None:
    context = {"x": "plain; import os", "xs": ["plain; import os"], "n": 3}
    filters = sorted(Templates(tmp_path)._environment.filters.keys() - FILTERS.keys())
    assert len(filters) > 30
    printed = []
    for used, value in ((f"{value}|{used}", value) for used in filters for value in context):
        (tmp_path / "t.j2").write_text("{{ " + used + " }}")
        try:
            made = Templates(tmp_path).render("t.j2", "m", **context)
        except TemplateFault:
            continue
        if "plain" in made:
            printed.append(f"{used}: {made} ({value})")
    assert printed == []


# -- the page --------------------------------------------------------------------------------------


def structs() -> list[type[program.Fact]]:
    found = [value for value in vars(program).values() if isinstance(value, type)]
    return [kind for kind in found if issubclass(kind, program.Fact) and kind is not program.Fact]


def test_the_page_names_every_template_struct_field_block_and_filter() -> None:
    text = PAGE.read_text()
    missing = [path.name for path in OURS.glob("*.j2") if f"`{path.name}`" not in text]
    missing += [f"|{key}" for key in FILTERS if f"`{key}`" not in text]
    for path in OURS.glob("*.j2"):
        blocks = re.findall(r"{% block (\w+)", path.read_text())
        missing += [f"{path.name}: {block}" for block in blocks if f"`{block}`" not in text]
    for kind in structs():
        section = re.search(rf"^\| `{kind.__name__}` \|(.*)$", text, re.MULTILINE)
        if section is None:
            missing.append(kind.__name__)
            continue
        fields = [field.name for field in msgspec.structs.fields(kind)]
        missing += [f"{kind.__name__}.{f}" for f in fields if f"`{f}`" not in section[1]]
    assert missing == []
    assert f"`context_version` is {program.CONTEXT_VERSION}" in text


def test_generating_is_the_same_wherever_it_is_run(tmp_path: Path) -> None:
    before = Path.cwd()
    try:
        os.chdir(tmp_path)
        elsewhere = run(tmp_path, "--transport", "ros2", model=SYSTEM)
        there = {p.name: p.read_bytes() for p in (tmp_path / "out").rglob("*.py")}
        os.chdir(ROOT)
        (tmp_path / "out").rename(tmp_path / "first")
        here = run(tmp_path, "--transport", "ros2", model=SYSTEM)
        assert elsewhere.exit_code == here.exit_code == 0
        assert there == {p.name: p.read_bytes() for p in (tmp_path / "out").rglob("*.py")}
    finally:
        os.chdir(before)
