"""A faulty input for every rule of the check; what is said of it stands in docs/rules.md."""

from __future__ import annotations

import msgspec

NS = 'xmlns="http://www.w3.org/2005/07/scxml" version="1.0"'


class Example(msgspec.Struct, frozen=True):
    """Files by name, and the arguments of ``m2c check`` (the first file if there are none)."""

    files: dict[str, str]
    arguments: tuple[str, ...] = ()


def machine(body: str, name: str = "M", initial: str = "a") -> str:
    return f'<scxml {NS} name="{name}" initial="{initial}">{body}</scxml>'


def model(body: str) -> Example:
    return Example({"m.scxml": machine(body)})


def data(kind: str, value: str, name: str = "n") -> Example:
    return model(f'<datamodel><data id="{name}" type="{kind}" expr="{value}"/></datamodel>{STATE}')


def entry(content: str, before: str = "") -> Example:
    return model(f'{before}<state id="a"><onentry>{content}</onentry></state>')


def sends(event: str, param: str, value: str) -> str:
    sent = f'<send event="{event}"><param name="{param}" expr="{value}"/></send>'
    return f'<state id="a"><onentry>{sent}</onentry></state>'


def log(expression: str) -> Example:
    return entry(
        f'<log expr="{expression}"/>', '<datamodel><data id="level" type="int8"/></datamodel>'
    )


def lenient(example: Example) -> Example:
    return Example(example.files, ("--lenient", *example.files))


STATE = '<state id="a"/>'
TICK = '<ros_service_server service_name="/s/tick" type="std_srvs/Trigger"/>'
TAKE = '<ros_service_handle_request name="/s/tick"'
ANSWER = (
    '<ros_service_send_response name="/s/tick"><field name="success" expr="true"/>'
    '<field name="message" expr="\'\'"/></ros_service_send_response>'
)
GOAL = '<ros_action_client action_name="/f" type="example_interfaces/Fibonacci"/>'
SERVE = f"{TAKE}>{ANSWER}</ros_service_handle_request>"
OUT = '<ros_topic_publisher topic="/t" type="std_msgs/Int32"/>'
IN = '<ros_topic_subscriber topic="/t" type="std_msgs/Int32"/>'
SKILL = machine(
    '<ros_service_server service_name="/Skill/tick" type="t/TickAction"/><state id="a">'
    '<ros_service_handle_request name="/Skill/tick"><ros_service_send_response name="/Skill/tick">'
    '<field name="status" expr="0"/></ros_service_send_response></ros_service_handle_request></state>',
    "Skill",
)
LEAF = '<Action ID="ROS2Action" name="Go" service_name="/Skill/tick"/>'
PLUGIN = machine(
    '<bt_declare_port_in key="poi" type="int32"/><state id="a"><bt_tick>'
    '<bt_return_status status="SUCCESS"/></bt_tick></state>',
    "Visit",
)


def system(*models: str, policy: str = "", extra: str = "", plugin: str = "") -> Example:
    """A system file with ``models`` and perhaps a policy."""
    nodes = "".join(f'<input type="node-ascxml" src="{i}.scxml"/>' for i in range(len(models)))
    files = {f"{i}.scxml": text for i, text in enumerate(models)}
    tree = '<input type="bt.cpp-xml" src="policy.xml"/>' if policy else ""
    if policy:
        files["policy.xml"] = policy
    if plugin:
        files["plugin.scxml"] = plugin
        tree += '<input type="bt-plugin-ascxml" src="plugin.scxml"/>'
    tree = f"<behavior_tree>{tree}</behavior_tree>" if tree else ""
    text = f"<roaml>{tree}<node_models>{nodes}</node_models>{extra}</roaml>"
    interfaces = {
        "interfaces/t/srv/TickAction.srv": "---\nint8 status\n",
        "interfaces/t/srv/TickCondition.srv": "---\nint8 status\n",
        "interfaces/t/srv/HaltAction.srv": "---\nbool is_ok\n",
    }
    return Example({"system.xml": text, **files, **interfaces})


def qos(topics: str) -> Example:
    body = f'{OUT}<state id="a"><onentry><ros_topic_publish name="/t"><field name="data" expr="1"/>'
    return system(
        machine(f"{body}</ros_topic_publish></onentry></state>"), extra=f"<qos>{topics}</qos>"
    )


def declaring(kind: str, text: str) -> Example:
    """A system whose data types are declared by ``text``."""
    extra = f'<data_declarations><input type="{kind}" src="types.{kind}"/></data_declarations>'
    declared = system(machine(STATE), extra=extra)
    return Example({**declared.files, f"types.{kind}": text})


def tree(*trees: str, attributes: str = 'main_tree_to_execute="Main"') -> Example:
    body = "".join(trees)
    policy = f'<root BTCPP_format="4" {attributes}>{body}</root>'
    return system(SKILL, policy=policy, plugin=PLUGIN)


def instance(content: str) -> Example:
    """A system of one model with data ``level``, whose input has ``content``."""
    text = (
        '<roaml><node_models><input type="node-ascxml" src="M.scxml" name="Mine">'
        f"{content}</input></node_models></roaml>"
    )
    data = '<datamodel><data id="level" type="int32" expr="0"/></datamodel>'
    return Example({"system.xml": text, "M.scxml": machine(data + STATE)}, ("system.xml",))


def including(files: int) -> Example:
    """A policy in ``files`` files, each included by the one before."""
    main = tree(*(['<include path="1.xml"/>', f'<BehaviorTree ID="Main">{LEAF}</BehaviorTree>']))
    parts = {
        f"{i}.xml": f'<root BTCPP_format="4"><include path="{i + 1}.xml"/></root>'
        for i in range(1, files)
    }
    last = {f"{files}.xml": '<root BTCPP_format="4"/>'}
    return Example({**main.files, **parts, **last})


def main_tree(content: str) -> Example:
    return tree(f'<BehaviorTree ID="Main">{content}</BehaviorTree>')


def definition(name: str, text: str) -> Example:
    using = machine(
        f'<ros_topic_subscriber topic="/x" type="t/{name}"/><state id="a">'
        '<ros_topic_callback name="/x"/></state>'
    )
    return Example({"m.scxml": using, f"interfaces/t/msg/{name}.msg": text})


def listed(used: str, interfaces: str, declaration: str = "") -> Example:
    """The earlier tool's full model with one component, and its interface list."""
    full = (
        f'<specification><model><componentList><componentDeclaration id="C"{declaration}>'
        '<componentDefinition moc="fsm" path="c.scxml"/></componentDeclaration></componentList></model>'
        "</specification>"
    )
    files = {"full.xml": full, "list.xml": interfaces, "c.scxml": used}
    return Example(files, ("--model", "full.xml", "--interfaces", "list.xml"))


def function(name: str, kind: str) -> str:
    ros = f'<ROS2data><interface type="{kind}"/></ROS2data>'
    return (
        f'<interfaces><interface id="level"><function id="{name}"><protocol>{ros}</protocol></function>'
        "</interface></interfaces>"
    )


def client(channel: str, name: str = "Client") -> str:
    return machine(
        f'<ros_service_client service_name="{channel}" type="std_srvs/Trigger"/><state id="a"><onentry>'
        f'<ros_service_send_request name="{channel}"/></onentry>'
        f'<ros_service_handle_response name="{channel}"/></state>',
        name,
    )


def server(name: str = "Server", kind: str = "Trigger", channel: str = "/s/tick") -> str:
    answer = (
        SERVE
        if kind == "Trigger"
        else SERVE.replace(ANSWER, TAKE.replace("handle_request", "send_response") + "/>")
    )
    text = f'{TICK}<state id="a">{answer}</state>'.replace("Trigger", kind)
    return machine(text.replace("/s/tick", channel), name)


READER = machine(f'{IN}<state id="a"><ros_topic_callback name="/t"/></state>', "Reader")

RULE_EXAMPLES: dict[str, Example] = {
    "unreadable-file": Example({}, ("none.scxml",)),
    "malformed-xml": Example({"m.scxml": "<scxml><state></scxml>"}),
    "malformed-json": declaring("json", '{"title" "Point"}'),
    "hostile-xml": Example({"m.scxml": '<!DOCTYPE l [<!ENTITY a "ha">]><scxml/>'}),
    "no-models": Example({"models/readme.txt": ""}, ("models",)),
    "mixed-input": Example(
        {"system.xml": "<roaml/>", "m.scxml": machine(STATE)}, ("system.xml", "m.scxml")
    ),
    "missing-file": system(
        extra='<behavior_tree><input type="bt.cpp-xml" src="polcy.xml"/></behavior_tree>'
    ),
    "missing-element": Example({"full.xml": "<specification/>"}),
    "duplicate-policy": system(
        extra='<behavior_tree><input type="bt.cpp-xml" src="system.xml"/>'
        '<input type="bt.cpp-xml" src="system.xml"/></behavior_tree>'
    ),
    "bad-parameter": system(
        machine(STATE), extra='<parameters><max_time value="ten" unit="s"/></parameters>'
    ),
    "bad-deployment": system(
        machine(STATE),
        extra='<deployment><process name="all"><node name="Bb"/></process></deployment>',
    ),
    "bad-quality": qos('<topic name="/t" reliability="best"/>'),
    "duplicate-quality": qos('<topic name="/t"/><topic name="/t" durability="transient_local"/>'),
    "unknown-topic": qos('<topic name="/tt" durability="transient_local"/>'),
    "unknown-tag": model('<stat id="a"/>'),
    "unknown-attribute": model('<state id="a"><transition tarket="a"/></state>'),
    "missing-attribute": model('<state id="a"><onentry><assign expr="1"/></onentry></state>'),
    "unsupported-element": model(f'<parallel id="p"/>{STATE}'),
    "no-states": model("<datamodel/>"),
    "bad-name": data("int8", "0", name="1a"),
    "duplicate-state": model(STATE + STATE),
    "duplicate-data": model(
        f'<datamodel><data id="n" expr="1"/><data id="n" expr="2"/></datamodel>{STATE}'
    ),
    "duplicate-interface": model(OUT + OUT + STATE),
    "duplicate-field": entry(
        '<ros_topic_publish name="/t"><field name="data" expr="1"/><field name="data" expr="2"/>'
        "</ros_topic_publish>",
        OUT,
    ),
    "unknown-target": model(
        '<state id="idle"/><state id="a"><transition event="e" target="idel"/></state>'
    ),
    "undeclared-interface": model(f'<state id="a">{TAKE}/></state>'),
    "undeclared-port": entry('<bt_set_output key="poi" expr="1"/>'),
    "unknown-child": entry('<bt_tick_child id="first"/>'),
    "bad-duration": model('<state id="a"><transition after="5 parsecs" target="a"/></state>'),
    "bad-rate": model(f'<ros_time_rate name="t" rate_hz="0"/>{STATE}'),
    "bad-number": model(
        '<ros_action_server name="act" action_name="/act" type="example_interfaces/Fibonacci"/>'
        f'{STATE}<ros_action_thread name="act" n_threads="none" initial="a">{STATE}</ros_action_thread>'
    ),
    "thread-event": Example(
        {
            "m.scxml": machine(
                f'<ros_action_server name="act" action_name="/act" type="t/Do"/>{STATE}'
                '<ros_action_thread name="act" n_threads="1" initial="a"><state id="a">'
                '<ros_action_handle_goal name="act"/></state></ros_action_thread>'
            ),
            "interfaces/t/action/Do.action": "---\n---\n",
        }
    ),
    "bad-probability": model(
        '<state id="a"><transition event="e"><target id="a" prob="0.5"/><target id="a" prob="0.2"/>'
        "</transition></state>"
    ),
    "bad-status": entry('<bt_return_status status="OK"/>'),
    "unbound-event": model('<state id="a"><transition event="Arm.Grip.Return"/></state>'),
    "unsupported-event": system(
        machine('<state id="a"><onentry><send event="e" delay="1s"/></onentry></state>', "One"),
        machine('<state id="a"><transition event="e"/></state>', "Two"),
    ),
    "event-param-types": system(
        machine(sends("e", "n", "1"), "One"), machine(sends("e", "n", "true"), "Two")
    ),
    "untyped-event-param": model(sends("e", "n", "[]")),
    "bad-expression": log("1 +"),
    "unsupported-expression": log("eval(1)"),
    "bad-location": entry('<assign location="1" expr="2"/>'),
    "undeclared-variable": log("levle"),
    "event-data-not-available": log("_msg.data"),
    "unknown-field": model(
        f'{IN}<state id="a"><ros_topic_callback name="/t"><log expr="_msg.percentage"/>'
        "</ros_topic_callback></state>"
    ),
    "type-mismatch": log("level == 'low'"),
    "out-of-range": data("int8", "300"),
    "bad-initial-value": model(
        '<datamodel><data id="levels" type="int8[]" expr="[1, 2]"/>'
        f'<data id="n" type="int8" expr="levels[2]"/></datamodel>{STATE}'
    ),
    "unknown-type": data("intt8", "0"),
    "bad-interface": definition("Level", "int32\n"),
    "bad-structure": declaring("json", '{"type": "object"}'),
    "duplicate-type": declaring(
        "xml",
        "<types>{0}{0}</types>".format('<struct id="P"><member id="x" type="int8"/></struct>'),
    ),
    "recursive-type": definition("Level", "Level below\n"),
    "tick-contract": Example(
        {
            "m.scxml": SKILL,
            "interfaces/t/srv/TickAction.srv": "---\nint8 SUCCESS=1\nint8 FAILURE=0\nint8 status\n",
        }
    ),
    "bad-override": Example({"M.scxml": machine(STATE)}, ("M.scxml", "--param", "N.level=1")),
    "unknown-parameter": instance('<param name="leve" expr="1"/>'),
    "duplicate-parameter": instance(2 * '<param name="level" expr="1"/>'),
    "duplicate-node": system(READER, READER),
    "duplicate-server": system(server("One"), server("Two")),
    "type-disagreement": system(server("One"), server("Two", "Empty")),
    "missing-tree": tree(
        '<BehaviorTree ID="Main">' + LEAF + "</BehaviorTree>",
        attributes='main_tree_to_execute="Man"',
    ),
    "duplicate-tree": tree(*[f'<BehaviorTree ID="Main">{LEAF}</BehaviorTree>'] * 2),
    "missing-subtree": main_tree('<SubTree ID="Batery"/>'),
    "recursive-subtree": main_tree('<SubTree ID="Main"/>'),
    "recursive-include": tree(
        '<include path="policy.xml"/>', f'<BehaviorTree ID="Main">{LEAF}</BehaviorTree>'
    ),
    "deep-include": including(20),
    "deep-tree": tree(
        '<BehaviorTree ID="Main"><SubTree ID="T0"/></BehaviorTree>',
        *(f'<BehaviorTree ID="T{i}"><SubTree ID="T{i + 1}"/></BehaviorTree>' for i in range(300)),
        f'<BehaviorTree ID="T300">{LEAF}</BehaviorTree>',
    ),
    "large-tree": tree(
        '<BehaviorTree ID="Main"><SubTree ID="T0"/></BehaviorTree>',
        *(
            f'<BehaviorTree ID="T{i}"><Sequence><SubTree ID="T{i + 1}"/><SubTree ID="T{i + 1}"/>'
            "</Sequence></BehaviorTree>"
            for i in range(20)
        ),
        f'<BehaviorTree ID="T20">{LEAF}</BehaviorTree>',
    ),
    "unknown-node": main_tree(f"<Sequenze>{LEAF}</Sequenze>"),
    "unknown-port": main_tree(f'<Parallel succes_count="1">{LEAF}</Parallel>'),
    "bad-port": main_tree(f'<Parallel success_count="2">{LEAF}</Parallel>'),
    "unset-entry": main_tree('<ScriptCondition code="levle > 3"/>'),
    "child-count": main_tree(f"<Inverter>{LEAF}{LEAF}</Inverter>"),
    "leaf-address": main_tree('<Action ID="ROS2Action" name="Go"/>'),
    "leaf-port": main_tree('<Action ID="Visit" name="Go"/>'),
    "leaf-type": system(
        SKILL.replace("TickAction", "HaltAction").replace(
            '"status" expr="0"', '"is_ok" expr="true"'
        ),
        policy=f'<root BTCPP_format="4"><BehaviorTree ID="Main">{LEAF}</BehaviorTree></root>',
    ),
    "refused-policy": main_tree('<Script code="a:="/>'),
    "request-discarded": model(
        f'{TICK}<state id="a">{SERVE}<transition event="e" target="b"/></state><state id="b"/>'
    ),
    "request-unanswered": model(f'{TICK}<state id="a">{TAKE}/></state>'),
    "response-without-request": model(
        f'{TICK}<state id="a">{TAKE}>{ANSWER}{ANSWER}</ros_service_handle_request></state>'
    ),
    "goal-failure-unhandled": model(
        f'{GOAL}<state id="a"><onentry><ros_action_send_goal name="/f"><field name="order" expr="1"/>'
        "</ros_action_send_goal></onentry>"
        '<ros_action_handle_success_result name="/f" target="b"/></state><state id="b"/>'
    ),
    "unreachable-state": model(f'{STATE}<state id="b"/>'),
    "shadowed-transition": model(
        '<state id="a"><transition event="e"/><transition event="e" target="a"/></state>'
    ),
    "never-taken": model('<state id="a"><transition event="e" cond="1 == 2"/></state>'),
    "eventless-cycle": model('<state id="a"><transition target="a"/></state>'),
    "unread-input": model(IN + STATE),
    "unused-interface": model(OUT + STATE),
    "lenient-conversion": lenient(data("int8", "'3'")),
    "missing-package": Example(
        {
            "m.scxml": machine(
                '<ros_topic_subscriber topic="/x" type="stereo_msgs/DisparityImage"/><state id="a">'
                '<ros_topic_callback name="/x"/></state>'
            )
        },
        ("--transport", "ros2", "m.scxml"),
    ),
    "differing-definition": Example(
        {
            **definition("Level", "int8 litres\n").files,
            "other/t/msg/Level.msg": "float32 litres\n",
        },
        ("m.scxml", "--interfaces", "other"),
    ),
    "unset-output-field": entry('<ros_topic_publish name="/t"/>', OUT),
    "nobody-serves": Example(
        {"one.scxml": client("/Alarm/strat"), "two.scxml": server(channel="/Alarm/start")},
        ("one.scxml", "two.scxml"),
    ),
    "unknown-machine": entry('<send event="e" target="Arm"/>'),
    "undeclared-function": listed(READER, function("level", "topic")),
    "undeclared-list-entry": listed(READER, function("t", "topic"), ' interface="levle"'),
    "function-kind": listed(READER, function("t", "async-service")),
    "duplicate-input": Example({"m.scxml": machine(STATE)}, ("m.scxml", "m.scxml")),
    "unportable-name": model(
        '<ros_topic_publisher name="out" topic="/tank/fill-level" type="std_msgs/Int32"/>'
        '<state id="a"><onentry><ros_topic_publish name="out"><field name="data" expr="1"/>'
        "</ros_topic_publish></onentry></state>"
    ),
    "path-case": Example(
        {
            "system.xml": '<roaml><node_models><input type="node-ascxml" src="M.scxml"/></node_models></roaml>',
            "m.scxml": machine(STATE),
        }
    ),
    "xml-prologue": Example({"m.scxml": f'\n<?xml version="1.0"?>{machine(STATE)}'}),
    "xml-namespace": Example({"m.scxml": f'<scxml xmlns="..." name="M">{STATE}</scxml>'}),
    "braced-entry": main_tree('<SetBlackboard output_key="{n}" value="1"/>'),
    "leaf-kind": main_tree(LEAF.replace("Action ID", "Condition ID")),
    "output-read": model(
        '<bt_declare_port_out key="n" type="int32"/><datamodel><data id="n" type="int32"/></datamodel>'
        '<state id="a"><bt_tick><assign location="n"><expr><bt_get_input key="n"/></expr></assign>'
        '<bt_set_output key="n" expr="n + 1"/><bt_return_status status="SUCCESS"/></bt_tick></state>'
    ),
    "unset-port": main_tree('<Action ID="Visit" name="Go" poi="{poi}"/>'),
    "unserved-leaf": main_tree(LEAF.replace("/Skill", "/Skil")),
    "older-spelling": Example(
        {
            "m.scxml": machine(
                '<state id="a"><transition event="CMD_TICK"><send event="TICK_RESPONSE">'
                '<param name="status" expr="0"/></send></transition></state>',
                "Fill",
            )
        }
    ),
    "ignored-element": system(extra="<properties/>"),
    "provided-topic": system(
        machine(
            '<ros_topic_subscriber topic="clock" type="builtin_interfaces/Time"/>'
            '<state id="a"><ros_topic_callback name="/clock"/></state>'
        )
    ),
    "monitored-leaf": main_tree(LEAF.replace("/>", ' isMonitored="true"/>')),
    "policy-alone": Example(
        {
            "policy.xml": f'<root BTCPP_format="4"><BehaviorTree ID="Main">{LEAF}</BehaviorTree></root>'
        }
    ),
    "tree-beside": Example(
        {
            **(tour := main_tree('<SubTree ID="T"/>')).files,
            "trees.xml": f'<root><BehaviorTree ID="T">{LEAF}</BehaviorTree></root>',
        },
        tour.arguments,
    ),
    "ignored-attribute": main_tree(f'<Inverter _onSucces="n := 1">{LEAF}</Inverter>'),
    "empty-port": main_tree(f'<Parallel success_threshold="">{LEAF}{LEAF}</Parallel>'),
}
