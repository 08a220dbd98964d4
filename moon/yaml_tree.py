"""YAML that may be hostile, as a tree whose every part knows its place.

Only plain YAML: no tags, no anchors or aliases (so no expansion), bounded size and depth. The tree is
built from the parser's events, so that nothing is ever constructed and nothing recurses.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from m2c.diagnostics import DiagnosticLog, Position
from m2c.model.file_size import size_of
from m2c.model.paths import meant

MAX_BYTES = 1024 * 1024
MAX_DEPTH = 12
MAX_NODES = 50_000
"""Keys, values and lists; each may be worth a message, and a property needs about ten."""


class Scalar:
    """A text; ``plain`` if it was not quoted."""

    def __init__(self, text: str, plain: bool, position: Position) -> None:
        self.text, self.plain, self.position = text, plain, position


class Sequence:
    """A list."""

    def __init__(self, position: Position) -> None:
        self.items: list[YamlNode] = []
        self.position = position


class Mapping:
    """A map with texts as keys; ``keys`` says where each stands."""

    def __init__(self, position: Position) -> None:
        self.entries: dict[str, YamlNode] = {}
        self.keys: dict[str, Position] = {}
        self.position = position
        self.pending: Scalar | None = None

    def members(self) -> list[tuple[str, Position, YamlNode]]:
        """Each key, where it stands, and what it leads to."""
        return [(name, self.keys[name], node) for name, node in self.entries.items()]


YamlNode = Scalar | Sequence | Mapping


def read_yaml(path: Path, log: DiagnosticLog) -> YamlNode | None:
    """The tree of the file at ``path``; None after reporting what is wrong."""
    whole = Position(str(path))
    try:
        if size_of(path) > MAX_BYTES:
            log.error("hostile-yaml", whole, "", f"the file has more than {MAX_BYTES} bytes")
            return None
        content = path.read_bytes()
    except OSError as error:
        what = f"cannot read the file: {error.strerror}"
        log.error("unreadable-file", whole, "", what, meant(path))
        return None
    return parse_yaml(content, str(path), log)


def parse_yaml(content: bytes, file: str, log: DiagnosticLog) -> YamlNode | None:
    """The tree of ``content``, which messages call ``file``; None after reporting what is wrong."""
    from ruamel.yaml import YAML
    from ruamel.yaml.error import MarkedYAMLError, YAMLError

    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        log.error("malformed-yaml", Position(file, line, 1), "", "the file is not UTF-8")
        return None
    builder = _Builder(file, log)
    try:
        for event in YAML(typ="safe", pure=True).parse(text):
            if not builder.take(event):
                return None
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        at = Position(file, mark.line + 1, mark.column + 1) if mark is not None else Position(file)
        log.error("malformed-yaml", at, "", f"malformed YAML: {error.problem or error.context}")
        return None
    except YAMLError as error:
        reason = str(error).strip().splitlines()[0]
        log.error("malformed-yaml", Position(file, 1, 1), "", f"malformed YAML: {reason}")
        return None
    except (ValueError, RecursionError, AttributeError, IndexError, TypeError) as error:
        # the parser's own faults on strange input (bad escapes, directives) are the input's
        log.error("malformed-yaml", Position(file, 1, 1), "", f"malformed YAML: {error}")
        return None
    if builder.root is None:
        log.error("malformed-yaml", Position(file, 1, 1), "", "the file is empty")
    return builder.root


class _Builder:
    def __init__(self, file: str, log: DiagnosticLog) -> None:
        self._file = file
        self._log = log
        self._stack: list[Sequence | Mapping] = []
        self._nodes = 0
        self.root: YamlNode | None = None

    def _refuse(self, position: Position, message: str, hint: str = "") -> bool:
        self._log.error("hostile-yaml", position, "", message, hint)
        return False

    def take(self, event: Any) -> bool:
        """Take one event in; False after reporting that the file is refused."""
        kind = type(event).__name__
        mark = event.start_mark
        at = Position(self._file, mark.line + 1, mark.column + 1) if mark else Position(self._file)
        if kind == "AliasEvent" or getattr(event, "anchor", None) is not None:
            return self._refuse(at, "anchors and aliases are refused", "write it out")
        if getattr(event, "tag", None) is not None:
            return self._refuse(at, f"the tag {event.tag} is refused", "plain values only")
        match kind:
            case "ScalarEvent":
                return self._add(Scalar(event.value, event.style is None, at))
            case "SequenceStartEvent" | "MappingStartEvent":
                node = Sequence(at) if kind[0] == "S" else Mapping(at)
                if len(self._stack) >= MAX_DEPTH:
                    return self._refuse(at, f"nested more than {MAX_DEPTH} deep")
                if not self._add(node):
                    return False
                self._stack.append(node)
            case "SequenceEndEvent" | "MappingEndEvent":
                self._stack.pop()
            case "DocumentStartEvent" if self.root is not None:
                return self._refuse(at, "a second document", "one document a file")
        return True

    def _add(self, node: YamlNode) -> bool:
        self._nodes += 1
        if self._nodes > MAX_NODES:
            return self._refuse(node.position, f"more than {MAX_NODES} keys and values")
        if not self._stack:
            self.root = node
            return True
        parent = self._stack[-1]
        if isinstance(parent, Sequence):
            parent.items.append(node)
            return True
        if parent.pending is None:
            if not isinstance(node, Scalar):
                return self._refuse(node.position, "a key is not a text")
            if node.text in parent.entries:
                return self._refuse(node.position, f"the key `{node.text}` stands here twice")
            parent.pending = node
            return True
        key, parent.pending = parent.pending, None
        parent.entries[key.text] = node
        parent.keys[key.text] = key.position
        return True
