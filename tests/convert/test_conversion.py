"""``m2c convert`` writes what was read: in one dialect, with comments, and with the same meaning."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from click.testing import CliRunner
from hypothesis import example, given, settings
from hypothesis import strategies as st

from m2c.cli import main
from m2c.convert.comparison import first_difference
from m2c.convert.expressions import respelled
from m2c.model import DiagnosticLog, Machine, Position, load
from m2c.model.loading import current_input_type
from tests.hostile.texts import PAYLOADS
from tests.w3c.nested import Made

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]
SHARED = ROOT.parent / "shared"
EXAMPLES = sorted(
    path
    for path in (ROOT / "examples").rglob("*.*")
    if path.suffix in (".scxml", ".ascxml") and "sorting_cell" not in path.parts
)
"""The models that can be read alone: those of the sorting cell have types of their system."""
SYSTEMS = sorted(
    path
    for path in (ROOT / "examples").rglob("*.xml")
    if "<roaml" in path.read_text(encoding="utf-8")
)
NS = 'xmlns="http://www.w3.org/2005/07/scxml"'
DIALECTS = {"ascxml": ".ascxml", "hl-scxml": ".scxml"}
ROOTS = re.compile("<(roaml|convince_mc_tc)")
COMMENT = re.compile(r"<!--.*?-->", re.DOTALL)


def run(*arguments: object) -> tuple[int, str]:
    result = CliRunner().invoke(main, ["convert", *map(str, arguments)])
    assert result.exception is None or isinstance(result.exception, SystemExit)
    return result.exit_code, result.output


def model(folder: Path, text: str, name: str = "m.scxml") -> Path:
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    return path


def converted(tmp_path: Path, text: str, dialect: str = "ascxml", name: str = "m.scxml") -> str:
    code, output = run(model(tmp_path, text, name), "-o", tmp_path / "out", "--to", dialect)
    assert code == 0, output
    return (tmp_path / "out" / name).with_suffix(DIALECTS[dialect]).read_text(encoding="utf-8")


def machine_of(path: Path, *folders: Path) -> Machine | None:
    log = DiagnosticLog()
    system = load([path], log, folders)
    return None if system is None or log.has_errors else system.nodes[0]


def assert_converts(path: Path, folder: Path, *interfaces: Path) -> None:
    """``path`` converts to each dialect; that is read as the same, has its comments, and stays as it is."""
    options = [word for item in interfaces for word in ("--interfaces", item)]
    machine = machine_of(path, *interfaces)
    for dialect, suffix in DIALECTS.items():
        code, output = run(path, "-o", folder / dialect, "--to", dialect, *options)
        assert code == 0, output
        made = (folder / dialect / path.name).with_suffix(suffix)
        again = machine_of(made, *interfaces)
        assert first_difference(machine, again, Position(str(path))) is None
        text = made.read_text(encoding="utf-8")
        assert COMMENT.findall(text) == COMMENT.findall(path.read_text(encoding="utf-8-sig"))
        run(made, "-o", folder / "again", "--to", dialect, *options)
        assert (folder / "again" / made.name).read_text(encoding="utf-8") == text


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: str(path.relative_to(ROOT)))
def test_every_example_converts_to_each_dialect(path: Path, tmp_path: Path) -> None:
    near = next((p / "interfaces" for p in path.parents if (p / "interfaces").is_dir()), None)
    assert_converts(path, tmp_path, *([near] if near else []))


@pytest.mark.parametrize("path", SYSTEMS, ids=lambda path: str(path.relative_to(ROOT)))
@pytest.mark.parametrize("dialect", DIALECTS)
def test_every_system_of_the_examples_converts(path: Path, dialect: str, tmp_path: Path) -> None:
    out = tmp_path / "out"
    code, output = run(path, "-o", out, "--to", dialect)
    assert code == 0, output
    made = next(out.rglob(path.name))
    assert output.startswith(f"{made}, with ")
    code = CliRunner().invoke(main, ["check", str(made)]).exit_code
    assert code == 0
    code, output = run(made, "-o", out, "--to", dialect)
    assert code == 0
    assert "(0 files written," in output


@pytest.mark.seed
@pytest.mark.skipif(not SHARED.is_dir(), reason="the published models are not beside the checkout")
@pytest.mark.parametrize("every", [5, pytest.param(1, marks=pytest.mark.soak)])
def test_published_models_that_are_accepted_convert(every: int, tmp_path: Path) -> None:
    folders = sorted(path for path in SHARED.rglob("interfaces") if path.is_dir())
    models = [path for path in sorted(SHARED.rglob("*.*scxml")) if machine_of(path, *folders)]
    assert len(models) > 80
    for number, path in enumerate(models[::every]):
        assert_converts(path, tmp_path / str(number), *folders)


@pytest.mark.seed
@pytest.mark.skipif(not SHARED.is_dir(), reason="the published models are not beside the checkout")
def test_published_plain_models_convert_with_their_components(tmp_path: Path) -> None:
    tour = SHARED / "seed_models" / "lab_tour"
    code, output = run(
        tour / "faulty_skills", tour / "components", "-o", tmp_path, "--interfaces", tour / "interfaces"
    )  # fmt: skip
    assert code == 0, output
    text = (tmp_path / "faulty_skills" / "T2-SetPoi1SkillSM.ascxml").read_text(encoding="utf-8")
    assert 'event="' not in text


@pytest.mark.seed
@pytest.mark.skipif(not SHARED.is_dir(), reason="the published models are not beside the checkout")
def test_every_published_system_that_is_accepted_converts(tmp_path: Path) -> None:
    files = [path for path in sorted(SHARED.rglob("*.xml")) if ROOTS.search(path.read_text())]
    accepted = []
    for path in files:
        log = DiagnosticLog()
        if load([path], log) is not None and not log.has_errors:
            accepted.append(path)
    assert accepted
    for number, path in enumerate(accepted):
        code, output = run(path, "-o", tmp_path / str(number))
        assert code == 0, output


PLAIN = f"""\
<!-- before -->
<?note kept?>
<scxml {NS} name="FillCondition" initial="a">
  <!-- first -->
  <state id="a">
    <transition event="CMD_TICK CMD_HALT own" type="internal" target="a">
      <!-- each -->
      <if cond="_event.data == undefined"><send event="TICK_RESPONSE">
        <param name="status" expr="0"/></send></if>
    </transition>
    <transition event="CMD_TICK" target="b"/>
  </state>
  <state id="b"><onentry><raise event="own"/></onentry></state>
</scxml>
<!-- after -->
"""


def test_plain_events_become_tags_with_typed_declarations(tmp_path: Path) -> None:
    text = converted(tmp_path, PLAIN)
    assert (
        text
        == f"""\
<?xml version="1.0" encoding="UTF-8"?>
<!-- before -->
<?note kept?>
<ascxml {NS} name="Fill" initial="a">
  <!-- first -->
  <ros_service_server service_name="/Fill/tick" type="bt_interfaces/TickCondition"/>
  <ros_service_server service_name="/Fill/halt" type="bt_interfaces/HaltAction"/>
  <state id="a">
    <ros_service_handle_request name="/Fill/tick" target="a">
      <!-- each -->
      <if cond="_req == undefined"><ros_service_send_response name="/Fill/tick">
        <field name="status" expr="0"/></ros_service_send_response></if>
    </ros_service_handle_request>
    <ros_service_handle_request name="/Fill/halt" target="a">
      <!-- each -->
      <if cond="_req == undefined"><ros_service_send_response name="/Fill/tick">
        <field name="status" expr="0"/></ros_service_send_response></if>
    </ros_service_handle_request>
    <transition event="own" type="internal" target="a">
      <!-- each -->
      <if cond="_event.data == undefined"><ros_service_send_response name="/Fill/tick">
        <field name="status" expr="0"/></ros_service_send_response></if>
    </transition>
    <ros_service_handle_request name="/Fill/tick" target="b"/>
  </state>
  <state id="b"><onentry><raise event="own"/></onentry></state>
</ascxml>
<!-- after -->
"""
    )


def test_calls_and_topics_of_plain_models_become_tags(tmp_path: Path) -> None:
    client = f"""<scxml {NS} name="Asks" initial="a"><datamodel><data id="n" expr="1"/></datamodel>
<state id="a"><onentry><send event="Tank.level.Pub" namelist="n"><param name="data" location="n"/></send>
<send event="Tank.Fill.Call"/></onentry><transition event="Tank.Fill.Return" cond="_event.data.success"
/><transition event="Tank.drops.Sub"><assign location="n" expr="_event.data.data"/></transition>
</state></scxml>"""
    tank = f"""<scxml {NS} name="Tank" initial="a">
<ros_service_server service_name="/Tank/Fill" type="std_srvs/Trigger"/>
<ros_topic_subscriber topic="/Tank/level" type="std_msgs/Int32"/>
<ros_topic_publisher topic="/Tank/drops" type="std_msgs/Int32"/><state id="a"/></scxml>"""
    paths = [model(tmp_path, client, "asks.scxml"), model(tmp_path, tank, "tank.scxml")]
    code, output = run(*paths, "-o", tmp_path / "out", "--to", "hl-scxml")
    assert code == 0, output
    text = (tmp_path / "out" / "asks.scxml").read_text()
    for line in (
        '<ros_topic_publisher topic="/Tank/level" type="std_msgs/Int32"/>',
        '<ros_service_client service_name="/Tank/Fill" type="std_srvs/Trigger"/>',
        '<ros_topic_subscriber topic="/Tank/drops" type="std_msgs/Int32"/>',
        '<ros_topic_publish name="/Tank/level"><field name="data" expr="n"/><field name="n" expr="n"/>',
        '<ros_service_send_request name="/Tank/Fill"/>',
        '<ros_service_handle_response name="/Tank/Fill" cond="_res.success"/>',
        '<ros_topic_callback name="/Tank/drops"><assign location="n" expr="_msg.data"/>',
    ):
        assert line in text


def test_markup_of_other_namespaces_is_left_out(tmp_path: Path) -> None:
    text = """<s:scxml xmlns:s="http://www.w3.org/2005/07/scxml" name="Lamp" xmlns:qt="urn:qt" qt:x="1">
    <qt:info><s:state id="b"/></qt:info> <s:state id="a" qt:id="c" my:initial="b"><bt_tick/></s:state><!-- kept --> </s:scxml>"""
    made = converted(tmp_path, text, "ascxml", "Lamp.scxml")
    assert "qt" not in made
    assert 'id="b"' not in made
    assert_converts(tmp_path / "Lamp.scxml", tmp_path / "made")


def test_a_name_that_is_the_file_s_is_written_down(tmp_path: Path) -> None:
    for name in ("", 'name=" "'):
        text = f'<ascxml {name}><state><bt_tick target="b"/></state><state id="b"/></ascxml>'
        assert 'name="Lamp"' in converted(tmp_path, text, "hl-scxml", "Lamp.ascxml")
        assert_converts(tmp_path / "Lamp.ascxml", tmp_path / "made")


def test_older_spellings_of_plugins_become_today_s(tmp_path: Path) -> None:
    old = f"""<q:scxml {NS} xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" xsi:schemaLocation="a b"
 xml:lang="en" name="Visit" initial="a"><ros_service_client service="/s" type="std_srvs/srv/Empty" name="s"/>
<datamodel><data id="done" expr="True || 'True'"/></datamodel>
<state id="a"><transition event="bt_tick" target="a"><bt_return_status status="SUCCESS"/></transition>
<transition event="bt_halt"><send event="bt_halt_response"/></transition>
<bt_tick><send event="bt_failure"/></bt_tick></state></q:scxml>"""
    text = converted(tmp_path, old, "hl-scxml")
    assert f'<scxml {NS} xml:lang="en" name="Visit" initial="a">' in text
    for line in (
        '<ros_service_client type="std_srvs/srv/Empty" name="s" service_name="/s"/>',
        '<data id="done" expr="true || \'True\'"/>',
        '<bt_tick target="a"><bt_return_status status="SUCCESS"/></bt_tick>',
        "<bt_halt><bt_return_halted/></bt_halt>",
        '<bt_tick><bt_return_status status="FAILURE"/></bt_tick>',
    ):
        assert line in text
    assert "xsi" not in text


@pytest.mark.parametrize(
    ("text", "data", "expected"),
    [
        (" True ", "", " true "),
        ("a == False && 'False'", "", "a == false && 'False'"),
        ("_event.data.n + _event.data.m", "_msg", "_msg.n + _msg.m"),
        ("'_event.data' + _event.data.n", "_res", "'_event.data' + _res.n"),
        ("_event.data.n", "", "_event.data.n"),
        ("(_event).data.n", "_msg", "(_event).data.n"),
        ("True +", "", "True +"),
        ("x.True", "", "x.True"),
    ],
)
def test_an_expression_is_respelled_where_it_means_that(
    text: str, data: str, expected: str
) -> None:
    assert respelled(text, data) == expected


def test_what_no_element_says_is_an_error_and_nothing_is_written(tmp_path: Path) -> None:
    text = PLAIN.replace('<send event="TICK_RESPONSE">', '<send event="TICK_RESPONSE" delay="1s">')
    path = model(tmp_path, text)
    code, output = run(path, "-o", tmp_path / "out")
    assert code == 2
    assert output == (
        f"{path}:8:43: error: <send>: `TICK_RESPONSE` goes to another node, and no element sends that "
        "after a delay; send an event to the machine itself after the delay, and this one when it comes "
        "[unfaithful-conversion]\n"
    )
    assert sorted(item.name for item in tmp_path.iterdir()) == ["m.scxml"]


def test_a_name_that_means_a_channel_in_the_other_dialect_is_an_error(tmp_path: Path) -> None:
    text = f'<ascxml {NS} name="M" initial="a"><state id="a"><transition event="CMD_TICK"/></state></ascxml>'
    path = model(tmp_path, text, "m.ascxml")
    code, output = run(path, "-o", tmp_path / "out", "--to", "hl-scxml")
    assert code == 2
    assert f"{path}:1:" in output
    assert "this would not mean the same in hl-scxml" in output
    assert not (tmp_path / "out").exists()


def test_an_array_of_up_to_so_many_is_written_so_in_hl_scxml(tmp_path: Path) -> None:
    data = '<datamodel><data id="few" type="int32[][3]" expr="[[1]]"/></datamodel><state id="a"/>'
    path = model(tmp_path, f'<ascxml {NS} name="M" initial="a">{data}</ascxml>', "m.ascxml")
    code, output = run(path, "-o", tmp_path / "out", "--to", "hl-scxml")
    assert code == 0, output
    assert 'type="int32[][&lt;=3]"' in (tmp_path / "out" / "m.scxml").read_text()


def test_an_array_of_always_so_many_cannot_be_said_in_ascxml(tmp_path: Path) -> None:
    data = '<datamodel><data id="three" type="int32[3]"/></datamodel><state id="a"/>'
    path = model(tmp_path, f'<scxml {NS} name="M" initial="a">{data}</scxml>')
    code, output = run(path, "-o", tmp_path / "out")
    assert code == 2
    assert "this would not mean the same in ascxml" in output


def test_models_that_are_refused_are_not_converted(tmp_path: Path) -> None:
    path = model(tmp_path, f'<scxml {NS} name="M" initial="b"><state id="a"/></scxml>')
    code, output = run(path, "-o", tmp_path / "out")
    assert code == 2
    assert output.count("error:") == 1
    assert "[unknown-target]" in output
    assert not (tmp_path / "out").exists()


def test_two_models_that_would_be_one_file_are_an_error(tmp_path: Path) -> None:
    text = '<{0} {1} name="{2}" initial="a"><state id="a"/></{0}>'
    one = model(tmp_path, text.format("scxml", NS, "One"), "m.scxml")
    other = model(tmp_path, text.format("ascxml", NS, "Two"), "m.ascxml")
    code, output = run(one, other, "-o", tmp_path / "out")
    assert code == 2
    assert "would both be m.ascxml" in output
    assert not (tmp_path / "out").exists()


def test_files_that_exist_are_overwritten_only_by_force(tmp_path: Path) -> None:
    path = model(tmp_path, PLAIN)
    mine = model(tmp_path, "mine", "out/m.ascxml")
    code, output = run(path, "-o", tmp_path / "out")
    assert code == 2
    assert output.splitlines()[:2] == [
        "error: this file exists; nothing was written:",
        f"  {mine}",
    ]
    assert mine.read_text() == "mine"
    assert run(path, "-o", tmp_path / "out", "--force")[0] == 0
    assert mine.read_text() != "mine"


SYSTEM = """\
<convince_mc_tc>
  <!-- rate -->
  <mc_parameters><bt_tick_rate value="5"/></mc_parameters>
  <behavior_tree><input type="bt.cpp-xml" src="../policy.xml"/></behavior_tree>
  <node_models><input type="scxml" src="../Models/m.scxml"/></node_models>
  <qos><topic name="/t" latched="true"/></qos>
  <properties><input src="loop"/><input type="jani" src="http://p/x"/></properties>
</convince_mc_tc>
"""
TREE = '<root BTCPP_format="4"><BehaviorTree ID="Main"><AlwaysSuccess/></BehaviorTree></root>'
TYPED = f"""<scxml {NS} name="M" initial="a"><datamodel><data id="p" type="g/Point"/></datamodel>
<ros_topic_publisher topic="/t" type="g/Point"/><state id="a"/></scxml>"""


def test_a_system_file_names_the_converted_models(tmp_path: Path) -> None:
    given = tmp_path / "given"
    model(given, SYSTEM, "systems/main.xml")
    (given / "systems/loop").symlink_to("loop")
    model(given, TYPED, "models/m.scxml")
    model(given, TREE, "policy.xml")
    model(given, "int8 x", "interfaces/g/msg/Point.msg")
    code, output = run(given / "systems/main.xml", "-o", tmp_path / "out")
    assert code == 0, output
    made = tmp_path / "out/systems/main.xml"
    assert output.splitlines()[-1].startswith(
        f"{made}, with 1 model in {tmp_path / 'out'}: read back"
    )
    assert (
        made.read_text()
        == f"""\
<?xml version="1.0" encoding="UTF-8"?>
<roaml>
  <!-- rate -->
  <parameters><bt_tick_rate value="5"/></parameters>
  <behavior_tree><input type="bt.cpp-xml" src="../../given/policy.xml"/></behavior_tree>
  <node_models><input type="{current_input_type("scxml")}" src="../models/m.ascxml"/></node_models>
  <qos><topic name="/t" durability="transient_local"/></qos>
  <properties><input src="../../given/systems/loop"/><input type="jani" src="http://p/x"/></properties>
  <interfaces><input type="ros-interfaces" src="../../given/interfaces"/></interfaces>
</roaml>
"""
    )
    result = CliRunner().invoke(main, ["check", "--format", "json", str(made)])
    assert [item["rule"] for item in json.loads(result.output) if item["severity"] == "error"] == []


def test_a_full_model_keeps_its_form_and_names_the_converted_models(tmp_path: Path) -> None:
    text = """<specification xmlns="..."><model><componentList><componentDeclaration id="M">
<componentDefinition moc="fsm" path="m.scxml"/></componentDeclaration></componentList></model></specification>"""
    model(tmp_path, text, "full.xml")
    model(tmp_path, f'<scxml {NS} name="M" initial="a"><state id="a"/></scxml>')
    code, output = run("--model", tmp_path / "full.xml", "-o", tmp_path / "out")
    assert code == 0, output
    assert 'moc="fsm" path="./m.ascxml"' in (tmp_path / "out/full.xml").read_text()


def test_a_folder_keeps_its_shape(tmp_path: Path) -> None:
    text = '<scxml {0} name="{1}" initial="a"><state id="a"/></scxml>'
    model(tmp_path, text.format(NS, "A"), "in/x/a.scxml")
    model(tmp_path, text.format(NS, "B"), "in/y/b.scxml")
    assert run(tmp_path / "in", "-o", tmp_path / "out")[0] == 0
    files = sorted(path.relative_to(tmp_path / "out") for path in (tmp_path / "out").rglob("*.*"))
    assert files == [Path("x/a.ascxml"), Path("y/b.ascxml")]


def escaped(text: str) -> str:
    """``text`` as XML's attributes say it, without the characters that XML has not."""
    kept = re.sub("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]", "", text)
    return "".join(f"&#{ord(c)};" if c in "&<>\"'\n\r\t" else c for c in kept)


@settings(max_examples=60)
@given(text=st.text(max_size=40) | st.sampled_from(PAYLOADS))
@example(text='" onload="x')
@example(text="]]><!--")
@example(text="-->")
def test_hostile_text_is_written_as_it_was_read(
    text: str, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("hostile")
    said = escaped(f"x{text}x")
    quoted = escaped(json.dumps(text.replace("\0", "")))
    path = model(
        folder,
        f'<scxml {NS} name="M" initial="{said}"><datamodel><data id="s" type="string" expr="{quoted}"/>'
        f'</datamodel><state id="{said}"><onentry><log label="{said}" expr="s"/></onentry>'
        f'<transition event="own" target="{said}"/></state></scxml>',
    )
    if machine_of(path) is None:  # refused: too long a name, half a surrogate pair
        return
    assert_converts(path, folder)


NESTED = """<scxml {0} name="M" initial="deep">
  <datamodel><data id="n" type="int32" expr="0"/></datamodel>
  <ros_topic_subscriber name="in" topic="/in" type="std_msgs/Int32"/>
  <!-- outer -->
  <state id="outer">
    <datamodel><data id="inner_n" type="int32" expr="2"/></datamodel>
    <initial><transition target="was"><assign location="n" expr="1"/></transition></initial>
    <history id="was" type="deep"><!-- first --><transition target="deep"><log label="first"/></transition></history>
    <ros_topic_callback name="in" target="deep" type="internal" cond="In('deep') &amp;&amp; _msg.data &gt; n"/>
    <transition event="done.state.middle" cond="_event.data.found == 3" target="other"/>
    <transition after="2s" target="was"/>
    <state id="middle">
      <state><transition event="next" target="deep"/></state>
      <state id="deep"><transition event="next" target="end"/><onexit><raise event="next"/></onexit></state>
      <final id="end"><donedata><param name="found" expr="3"/></donedata></final>
    </state>
  </state>
  <state id="other"><transition event="next" target="was"/></state>
</scxml>"""


def test_compound_states_convert_to_each_dialect(tmp_path: Path) -> None:
    assert_converts(model(tmp_path, NESTED.format(NS)), tmp_path / "out")
    text = converted(tmp_path, NESTED.format(NS))
    for kept in ('<history id="was" type="deep">', "<donedata>", "In('deep')", 'type="internal"'):
        assert kept in text


@pytest.mark.parametrize("seed", range(10))
def test_nested_machines_made_at_random_convert(seed: int, tmp_path: Path) -> None:
    assert_converts(model(tmp_path, Made(seed).text()), tmp_path / "out")


def test_plain_models_with_compound_states_convert(tmp_path: Path) -> None:
    text = converted(
        tmp_path,
        f"""<scxml {NS} name="LevelSkill" initial="on">
          <state id="on"><history id="h"><transition target="idle"/></history>
            <transition event="CMD_TICK" target="h"><send event="TICK_RESPONSE"/></transition>
            <state id="idle"/><state id="busy"/>
          </state></scxml>""",
        name="LevelSkill.scxml",
    )
    assert "ros_service_handle_request" in text
    assert '<history id="h">' in text
