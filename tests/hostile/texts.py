"""Hostile texts, and for each kind of slot those of them that are meant to pass the check.

A payload that would run leaves a mark: every one has the word ``PWNED``.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Callable, Iterable

from hypothesis import strategies as st

MARK = "PWNED"
_RUN = f'__import__("os").system("touch {MARK}")'
_RUN_1 = _RUN.replace('"', "'")

PAYLOADS = (
    # a string literal, a docstring, an f-string, a comment, a dictionary's key
    f'"); {_RUN}; ("',
    f"'); {_RUN_1}; ('",
    f'" + {_RUN} + "',
    f"' + {_RUN_1} + '",
    f'"""\n{_RUN}\n"""',
    f'"""; {_RUN}; """',
    f"'''; {_RUN_1}; '''",
    f'``"""\nimport os\nos.system(\'touch {MARK}\')\n"""',
    f"\\''''; {_RUN_1}  # ",
    f"{{{_RUN}}}",
    f"{{{_RUN}!r:>10}}",
    f"# {MARK}",
    f"x  # noqa\n{_RUN}",
    f'": {_RUN}, "',
    f"': {_RUN_1}, '",
    f"\\\n{_RUN}",
    f"\r{_RUN}",
    f"\x0c{_RUN}",
    f"\u2028{_RUN}",
    f"\x85{_RUN}",
    # names of methods and classes, imports, decorators
    f"x(self): pass\n{_RUN}\ndef y",
    f"x; {_RUN}; y",
    f"x, {MARK}",
    f"os; import {MARK}",
    f"m2c as m, {MARK}",
    f"__import__('os').system('touch {MARK}')",
    f"x=lambda: {MARK}()",
    f"x[{_RUN}]",
    f"@{MARK}",
    f"{MARK}()",
    # templates
    f"{{{{ {_RUN} }}}}",
    f"{{% import {MARK} %}}",
    f"{{% raw %}}{{{{ {MARK} }}}}{{% endraw %}}",
    f"{{# {MARK} #}}",
    f"{{{{ cycler.__init__.__globals__.os.popen('touch {MARK}').read() }}}}",
    f"#}} {MARK}",
    f"-%}} {MARK} {{%-",
    # formats, shells
    f"$({_RUN})",
    f"$(touch {MARK})",
    f"`touch {MARK}`",
    f"%s %d %({MARK})s %",
    f"{{0}} {{}} {{{MARK}}} {{self}}",
    f"; touch {MARK} #",
    f"--{MARK}",
    # markup, TOML, JSON, configuration files, launch files
    f"</script><script>{MARK}()</script>",
    f'<img src=x onerror="{MARK}()">',
    f"]]> {MARK} <![CDATA[",
    f"--> {MARK} <!--",
    f"&amp; &lt;{MARK}&gt; &quot;",
    f"</description><name>{MARK}</name><description>",
    f'"\n[tool.{MARK}]\nx = "',
    f'"]\n{MARK} = ["',
    f'", "{MARK}": "',
    f"\n[{MARK}]\nx = %(y)s",
    f"${{var:={MARK}}}",
    f"$(env {MARK})",
    # paths
    f"../../{MARK}",
    f"/tmp/{MARK}",
    f"..\\{MARK}",
    f"~/{MARK}",
    # terminals
    f"\x1b[31m{MARK}\x1b[0m",
    f"\x1b]0;{MARK}\x07",
    f"\x9b31m{MARK}",
    f"\b\b\b{MARK}",
    f"\u202e{MARK}\u202c",
    f"\u2066{MARK}\u2069",
)
ODD = (
    *('"', "'", "`", '"""', "'''", "\\", "\\\\", 'a"', "a'", 'a"""', "a'''", "a\\", '"a', '""""'),
    *("{", "}", "{{", "}}", "{%", "%}", "{#", "#}", "{}", "{0}", "%", "%s", "%%", "$", "$$", "#"),
    *(":", ";", ",", "=", "()", "(", ")", "[", "]", "<", ">", "&", "|", "@", "!", "~", "^", "-"),
    *("\\n", "\\N{BELL}", "\\N{x}", "\\x", "\\x41", "\\u", "\\u0041", "\\U00110000", "\\0", "\\'"),
    *("a b", "a  b", "a\tb", "a\nb", "a\r\nb", "a\rb", "a\x00b", "a\x0bb", "a\x0cb", "a\u00a0b"),
    *(
        "é",
        "e\u0301",
        "ﬁ",
        "ª",
        "K",
        "Å",
        "ß",
        "İ",
        "ı",
        "漢字",
        "🤖",
        "עברית",
        "a\u200db",
        "\ufeffa",
    ),
    *("²", "①", "٣", "Ａ", "\u0301", "ǅ", "𝔘", "a·b", "℘", "a\u3000b", "\U0010fffd", "\u0378"),
    *("a-b", "a_b", "A_B", "aB", "a.b", "a b_", "_a_b", "a__b", "a_b_2", "AB", "ab", "ﬀ", "ff"),
    *(
        "1a",
        "1",
        "0x1",
        "1e5",
        "-1",
        "1.5",
        "NaN",
        "_",
        "__",
        "_1",
        "..",
        ".",
        ".a",
        "a.",
        "*",
        "a.*",
    ),
    *("true", "false", "null", "undefined", "None", "True", "False", "NotImplemented", "Ellipsis"),
    *("noqa: E501", "type: ignore", "fmt: off", "-*- coding: utf-7 -*-", "!/bin/sh", "%YAML"),
    'Warning (level 3), see "manual", and then turn it off, (or not), {maybe}, [later], and so on, and on',
    "a, b, c, (d, e), [f, g], 'h', \"i\", " * 6,
    "x" * 255,
    "x" * 300,
    "é" * 200,
    '"' * 255,
    "a b " * 60,
    "(" * 120,
)
WORDS = (
    # keywords and builtins of Python
    *(
        "class",
        "def",
        "import",
        "from",
        "lambda",
        "match",
        "case",
        "type",
        "pass",
        "return",
        "yield",
    ),
    *("print", "str", "list", "dict", "int", "float", "bool", "super", "object", "property", "len"),
    *(
        "Exception",
        "isinstance",
        "getattr",
        "exec",
        "eval",
        "compile",
        "open",
        "id",
        "vars",
        "range",
    ),
    # names of generated code
    *("self", "Enum", "Any", "Final", "Protocol", "ClassVar", "Annotated", "Callable", "Mapping"),
    *(
        "copy",
        "msgspec",
        "ecmascript",
        "Outputs",
        "_outputs",
        "outputs",
        "state",
        "start",
        "machine",
    ),
    *("node", "interfaces", "State", "Machine", "Node", "Binding", "TypedMessage", "BtNodeContext"),
    *(
        "_state",
        "_internal",
        "_failed",
        "_holds",
        "on_event",
        "on_entry",
        "_enter",
        "_exit",
        "_run",
    ),
    *("ports", "event", "data", "message", "request", "error", "settings", "transport", "main"),
    *(
        "ExecutionError",
        "EndlessLoopError",
        "matches",
        "seconds",
        "deque",
        "annotations",
        "thread_id",
    ),
    *("name", "value", "NODES", "POLICY", "PLUGINS", "run", "log", "say", "post", "timer", "tick"),
    *(
        "__init__",
        "__class__",
        "__dict__",
        "__slots__",
        "__name__",
        "__main__",
        "__doc__",
        "__file__",
    ),
    *(
        "mro",
        "_value_",
        "_missing_",
        "_ignore_",
        "_name_",
        "_generate_next_value_",
    ),  # an Enum's own
    # modules
    *("signal", "Signal", "Queue", "queue", "Types", "types", "enum", "Random", "random", "json"),
    *("JSON", "logging", "Logging", "typing", "collections", "test", "Test", "site", "os", "sys"),
    *("Threading", "Socket", "String", "Time", "Calendar", "encodings", "codecs", "Io", "Abc"),
    *(
        "m2c",
        "M2C",
        "moon",
        "Moon",
        "transports",
        "Transports",
        "tests",
        "setup",
        "launch",
        "rclpy",
    ),
    *("plugins", "policy_", "unnamed", "con", "nul", "aux", "resource", "lib", "pip", "setuptools"),
)
_LETTERS = (
    "\"'`\\{}%$#()[]<>&;:,.=*/-_+!?@^|~ \n\t\rabcAB019éﬁ\u0301\u202e\u200b\u0378\x85\x1b\x00漢🤖"
)

hostile_texts = st.one_of(
    st.sampled_from(PAYLOADS),
    st.sampled_from(ODD),
    st.sampled_from(WORDS),
    st.text(st.sampled_from(_LETTERS), min_size=1, max_size=40),
    st.text(min_size=1, max_size=12),
    st.builds(
        lambda one, two: one + two,
        st.sampled_from(PAYLOADS + ODD),
        st.sampled_from(PAYLOADS + ODD),
    ),
)
"""Any hostile text."""

_UNSEEN = {"Cc", "Zl", "Zp", "Cf", "Cn", "Cs"}


def is_xml(text: str) -> bool:
    """Whether XML 1.0 can carry ``text`` (its production Char)."""
    return all(
        letter in "\t\n\r"
        or "\x20" <= letter <= "\ud7ff"
        or ("\ue000" <= letter <= "\uffff" and letter not in "\ufffe\uffff")
        or letter >= "\U00010000"
        for letter in text
    )


def _is_name(text: str) -> bool:
    return (
        0 < len(text) <= 255
        # beside a node of that name std_msgs/String has a class of another name than in the twin
        and re.sub(r"[^0-9a-z]", "", text.lower()) != "string"
        and text == text.strip()
        and not any(unicodedata.category(letter) in _UNSEEN for letter in text)
    )


def _is_event(text: str) -> bool:
    tokens = text.split(".")
    # ``error`` is ``error.execution``, too: its test is written otherwise than the twin's
    return _is_name(text) and text != "error" and not re.search(r"\s|\*", text) and all(tokens)


def _is_channel(text: str) -> bool:
    parts = text.split("/")
    taken = not set(text) & set("*$?#") and not any(part.startswith("@") for part in parts)
    return _is_name(text) and len(text) <= 254 and taken and all(part.strip() for part in parts)


_ECMASCRIPT = frozenset(
    (
        *("break", "case", "catch", "class", "const", "continue", "debugger", "default", "delete"),
        *("do", "else", "enum", "export", "extends", "false", "finally", "for", "function", "if"),
        *(
            "import",
            "in",
            "instanceof",
            "new",
            "null",
            "return",
            "super",
            "switch",
            "this",
            "throw",
        ),
        *("true", "try", "typeof", "var", "void", "while", "with", "undefined", "True", "False"),
        *("Infinity", "NaN", "Math", "SUCCESS", "FAILURE", "RUNNING", "_msg", "_req", "_res"),
        *("_feedback", "_goal", "_result", "_event", "_action", "_wrapped_result", "_bt"),
    )
)


def _is_variable(text: str) -> bool:
    return (
        _is_name(text)
        and text not in _ECMASCRIPT
        and not unicodedata.category(text[0]).startswith(("M", "N"))
        and all(letter in "_$" or unicodedata.category(letter)[0] in "LMN" for letter in text)
        and all(unicodedata.category(letter) not in ("No", "Me", "Nl") for letter in text)
        and all(letter <= "\uffff" for letter in text)
    )


def _is_file(text: str) -> bool:
    return (
        _is_name(text)
        and "/" not in text
        and text not in (".", "..", MARK)  # a file called MARK is what a payload would make
        and len(text.encode("utf-8", "surrogatepass")) <= 200
    )


def _is_port(text: str) -> bool:
    """What an attribute of a policy may be called."""
    taken = ("name", "ID", "interface", "isMonitored", "service_name", "CHILDREN_COUNT")
    return re.fullmatch(r"[A-Za-zé漢][\w.-]{0,250}", text) is not None and text not in taken


def _is_text(text: str) -> bool:
    return is_xml(text) and len(text) < 2000


def _is_comment(text: str) -> bool:
    return is_xml(text) and "--" not in text and not text.endswith("-")


def _is_any(text: str) -> bool:
    return True


FITS: dict[str, Callable[[str], bool]] = {
    "name": _is_name,
    "event": _is_event,
    "channel": _is_channel,
    "variable": _is_variable,
    "file": _is_file,
    "port": _is_port,
    "text": _is_text,
    "label": _is_text,
    "comment": _is_comment,
    "literal": _is_any,
}
"""By kind of slot: whether a text is meant to be accepted there."""

_ALIKE = (
    "a-b",
    "a_b",
    "A_B",
    "aB",
    "a b",
    "a.b",
    "a__b",
    "-a-b-",
    "a_b_2",
    "a-b_2",
    "a_b_3",
    "'",
    '"',
)
ALIKE: dict[str, tuple[str, ...]] = {
    "name": _ALIKE,
    "event": tuple(text for text in _ALIKE if " " not in text),
    "channel": (*_ALIKE, "a/b", "A/B", "b", "a/a_b"),
    "file": _ALIKE,
    "port": ("a-b", "a_b", "A_B", "aB", "a.b", "a__b", "a_b_2"),
    "literal": (*_ALIKE, "", " a_b", "a_b "),
    "variable": (
        *(
            "ﬁ",
            "fi",
            "ª",
            "a",
            "K",
            "K",
            "Å",
            "Å",
            "é",
            "e\u0301",
            "state",
            "data_state",
            "_a",
            "__a",
        ),
        *("a_b", "A_b", "class_", "data_class", "on_a", "data_on_a", "self", "data_self", "ſ", "s"),
    ),
}
"""By kind of slot: texts that differ, and may not once they are made identifiers."""

_ROS_NAMES = (
    *("class", "import", "def", "lambda", "none", "true", "print", "str", "list", "super", "self"),
    *("copy", "msgspec", "ecmascript", "state", "start", "machine", "signal", "queue", "types"),
    *(
        "enum",
        "random",
        "json",
        "logging",
        "m2c",
        "moon",
        "transports",
        "test",
        "a",
        "a_b",
        "a1_b2",
    ),
    *(
        "data",
        "type",
        "name",
        "id",
        "match",
        "case",
        "init",
        "main",
        "node",
        "interfaces",
        "x" * 200,
    ),
    *("cls", "fields", "pwned", "os", "sys", "typing", "dataclass", "mro", "int", "field", "zero"),
)
_TYPES = (
    *("None", "True", "False", "Enum", "Any", "Protocol", "Outputs", "Struct", "TypedMessage"),
    *("ClassVar", "Annotated", "Int32", "Int64", "Node", "Binding", "Exception", "Type", "String"),
    *(
        "Request",
        "Response",
        "Final",
        "Callable",
        "Mapping",
        "State",
        "Machine",
        "PWNED",
        "X" * 150,
    ),
    *("Action", "Service", "Topic", "Transport", "Reliability", "NodeSettings", "GoalHandlers"),
)
_CONSTANTS = ("NONE", "TRUE", "A_B", "CLASS", "X", "A1", "DATA", "PWNED", "X" * 200)
FIXED = {
    "package": _ROS_NAMES,
    "type": _TYPES,
    "field": _ROS_NAMES,
    "constant": _CONSTANTS,
}
"""By kind of slot: the hostile texts that ROS 2 allows there, as it allows few."""

_POOL = tuple(dict.fromkeys((*PAYLOADS, *ODD, *WORDS)))


def texts_for(kind: str) -> st.SearchStrategy[str]:
    """Hostile texts of which the check is to accept nearly all in slots of ``kind``."""
    if kind in FIXED:
        return st.sampled_from(FIXED[kind])
    fits = FITS[kind]
    return st.one_of(
        st.sampled_from([text for text in _POOL if fits(text)]),
        st.sampled_from(_flattened(fits)),
        hostile_texts.map(lambda text: _made_to_fit(text, fits)),
    )


def _flattened(fits: Callable[[str], bool]) -> list[str]:
    """The payloads without what cannot be seen, where they fit then."""
    found = [_made_to_fit(text, fits) for text in (*PAYLOADS, *ODD)]
    return list(dict.fromkeys(found))


def _made_to_fit(text: str, fits: Callable[[str], bool]) -> str:
    for candidate in _nearer(text):
        if fits(candidate):
            return candidate
    return "x" + "".join(f"{ord(letter):x}" for letter in text)[:40]


def _nearer(text: str) -> Iterable[str]:
    yield text
    seen = "".join(letter for letter in text if unicodedata.category(letter) not in _UNSEEN)
    yield seen.strip()[:255].strip()
    joined = re.sub(r"\s", "\u00b7", seen.strip())[:255]
    yield joined
    yield re.sub(r"[/.*]", "\u00b7", joined)
    yield re.sub(r"-+", "-", seen).strip("-")
    yield "v" + re.sub(r"[^0-9A-Za-zéﬁª漢_$\u0301]", "_", text)[:200]
    yield "v" + re.sub(r"[^0-9A-Za-z_]", "_", text)[:200]
