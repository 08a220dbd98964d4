"""What the text of an ``.idl`` file defines: the part of OMG's IDL that ROS 2 makes types of.

https://design.ros2.org/articles/idl_interface_definition.html: structures in the modules ``package::msg``,
``package::srv`` and ``package::action``, type definitions, constants in a module ``Name_Constants``, and the
annotation ``@default``. What ``#include`` names is found by its own name.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

from m2c.diagnostics import DiagnosticLog, Position
from m2c.language.datatypes import Array, DataType, Primitive, Structure, describe
from m2c.model.constants import Value, parse_value, text_value

_TOKEN = re.compile(
    r"""(?P<blank>\s+|//[^\n]*|/\*.*?\*/|^[ \t]*\#[^\n]*)
    |(?P<text>L?"(?:[^"\\\n]|\\.)*")
    |(?P<word>[A-Za-z]\w*)
    |(?P<number>(?:[0-9]|\.[0-9])(?:[eE][+-]|[\w.])*)
    |(?P<symbol>::|[{}()<>\[\];:,=@+|*/%^&~-])""",
    re.VERBOSE | re.DOTALL | re.MULTILINE | re.ASCII,
)
_NOT_DECIMAL = re.compile(r"0[xX]|0[0-9]+\Z")
"""How hexadecimal and octal numbers begin, which IDL has."""
_TYPES = {
    **{name: name for name in ("int8", "int16", "int32", "int64", "char")},
    **{name: name for name in ("uint8", "uint16", "uint32", "uint64")},
    **{"boolean": "bool", "octet": "byte", "float": "float32", "double": "float64"},
    **{"short": "int16", "long": "int32", "long long": "int64"},
    **{"unsigned short": "uint16", "unsigned long": "uint32", "unsigned long long": "uint64"},
}
_CONSTANTS = "_Constants"
EMPTY = "structure_needs_at_least_one_member"
"""The field that stands in a structure without fields."""

Find = Callable[[str], Structure]


def read_idl(
    text: str,
    file: str,
    find: Find,
    log: DiagnosticLog,
    *,
    wide: str = "string",
    only: Sequence[str] = (),
) -> tuple[Structure, ...]:
    """The structures that ``text`` defines, by their names, ``pkg/msg/Name`` or ``pkg/srv/Name_Request``.

    Args:
        text: the definition.
        file: where it stands.
        find: gives the message types that it refers to; KeyError with a sentence for others.
        log: gets ``bad-interface`` or ``unknown-type`` for the first fault, after which nothing is read.
        wide: the primitive that a ``wstring`` is. Models have one kind of strings; on the wire there are two.
        only: the structures that a file may define, in their order: one of a message, two of a service, three
            of an action (rosidl_parser). Empty: any, as the definitions in a recording have.
    """
    reader = _Reader(text, file, find, wide)
    try:
        return reader.read(only)
    except _FaultError as fault:
        log.error(fault.rule, fault.at, "", fault.what, fault.hint)
        return ()


class _FaultError(Exception):
    def __init__(
        self, at: Position, what: str, hint: str = "", rule: str = "bad-interface"
    ) -> None:
        super().__init__(what)
        self.at, self.what, self.hint, self.rule = at, what, hint, rule


class _Token(NamedTuple):
    kind: str
    text: str
    at: Position


def _tokens(text: str, file: str) -> Iterator[_Token]:
    place, line, begin = 0, 1, 0
    while place < len(text):
        at = Position(file, line, place - begin + 1)
        match = _TOKEN.match(text, place)
        if match is None:
            shown = text[place : place + 20].split("\n", maxsplit=1)[0]
            raise _FaultError(at, f"`{shown}` is not IDL")
        if match.lastgroup == "number" and _NOT_DECIMAL.match(match[0]):
            what = f"`{match[0][:40]}` is no decimal number, and ROS 2 reads no other"
            raise _FaultError(at, what)
        if match.lastgroup != "blank":
            yield _Token(str(match.lastgroup), match[0], at)
        count = match[0].count("\n")
        if count:
            line, begin = line + count, place + match[0].rindex("\n") + 1
        place = match.end()
    yield _Token("end", "the end of the file", Position(file, line, place - begin + 1))


class _Reader:
    def __init__(self, text: str, file: str, find: Find, wide: str) -> None:
        self._texts = {"string": Primitive("string"), "wstring": Primitive(wide)}
        self._tokens = _tokens(text, file)
        self._next = next(self._tokens)
        self._find = find
        self._modules: list[str] = []
        self._aliases: dict[str, DataType] = {}
        self._made: dict[str, Structure] = {}
        self._places: dict[str, Position] = {}
        self._constants: dict[str, list[tuple[str, str, Value]]] = {}

    def read(self, only: Sequence[str]) -> tuple[Structure, ...]:
        while self._next.kind != "end":
            self._definition()
        if self._modules:
            raise self._unexpected("`}`")
        self._require(only)
        return tuple(
            Structure(made.name, made.fields, made.defaults, tuple(self._constants.get(name, ())))
            for name, made in self._made.items()
        )

    def _require(self, only: Sequence[str]) -> None:
        """Fault unless, if all of ``only`` are defined, nothing else is, and they in this order."""
        if not only or not self._made.keys() >= set(only):
            return
        for full, at in self._places.items():
            if full not in only:
                shown = full.replace("/", "::")
                what = f"`{shown}` is a further structure, and ROS 2 reads a file as one type"
                raise _FaultError(at, what, "define it in a file of its own")
        for name, full in zip(only, self._places, strict=True):
            if name != full:
                first, later = name.rpartition("/")[2], full.rpartition("/")[2]
                what = f"`{later}` stands before `{first}`"
                raise _FaultError(self._places[full], what, "ROS 2 takes them in the other order")

    # --- tokens ------------------------------------------------------------------------------------

    def _take(self, wanted: str = "") -> _Token:
        """The next token, which is ``wanted`` if that is given."""
        token = self._next
        if wanted and token.text != wanted:
            raise self._unexpected(f"`{wanted}`")
        if token.kind != "end":
            self._next = next(self._tokens)
        return token

    def _takes(self, text: str) -> bool:
        """Whether the next token was ``text``, which is taken then."""
        found = self._next.text == text and self._next.kind != "text"
        if found:
            self._take()
        return found

    def _name(self) -> _Token:
        if self._next.kind != "word":
            raise self._unexpected("a name")
        return self._take()

    def _unexpected(self, wanted: str) -> _FaultError:
        token = self._next
        shown = token.text if token.kind == "end" else f"`{token.text[:40]}`"
        return _FaultError(token.at, f"{shown} stands where {wanted} is expected")

    # --- definitions -------------------------------------------------------------------------------

    def _definition(self) -> None:
        if self._modules and self._takes("}"):
            self._modules.pop()
            self._take(";")
            return
        self._annotations()
        token = self._next
        if self._takes("module"):
            self._modules.append(self._name().text)
            self._take("{")
        elif self._takes("struct"):
            self._structure()
        elif self._takes("enum"):
            self._enumeration()
        elif self._takes("typedef"):
            kind = self._type()
            for name, declared in self._declared(kind):
                self._aliases[self._full(name.text)] = declared
        elif self._takes("const"):
            self._constant()
        else:
            shown = f"`{token.text[:40]}`" if token.kind != "end" else token.text
            raise _FaultError(
                token.at,
                f"{shown} defines nothing that ROS 2 has",
                "a definition is a module, struct, typedef or const",
            )

    def _full(self, name: str) -> str:
        return "/".join((*self._modules, name))

    def _annotations(self) -> tuple[_Token, ...]:
        """Skip annotations; what ``@default(value=…)`` among them says."""
        default: tuple[_Token, ...] = ()
        while self._takes("@"):
            name = self._name().text
            while self._takes("::"):
                name += f"::{self._name().text}"
            inside: list[_Token] = []
            if self._takes("("):
                depth = 1
                while depth and self._next.kind != "end":
                    token = self._take()
                    is_symbol = token.kind == "symbol"
                    depth += (token.text == "(") - (token.text == ")") if is_symbol else 0
                    inside.append(token)
                if depth:
                    raise self._unexpected("`)`")
            if name == "default" and [token.text for token in inside[:2]] == ["value", "="]:
                default = tuple(inside[2:-1])
        return default

    def _enumeration(self) -> None:
        """Skip it: ROS 2 reads enumerations, and has no values of them."""
        self._name()
        self._take("{")
        self._name()
        while self._takes(","):
            self._name()
        self._take("}")
        self._take(";")

    def _structure(self) -> None:
        name = self._name()
        full, at = self._full(name.text), name.at
        if self._takes(";"):  # a forward declaration
            return
        if full in self._made:
            raise _FaultError(name.at, f"a second structure is called `{name.text}`")
        self._take("{")
        if self._next.text == "}":
            what = f"`{name.text}` is empty, which no structure of ROS 2 is"
            raise _FaultError(name.at, what, f"write `uint8 {EMPTY};`")
        fields: dict[str, DataType] = {}
        defaults = []
        while not self._takes("}"):
            default = self._annotations()
            kind = self._type()
            for name, declared in self._declared(kind):
                if name.text in fields:
                    raise _FaultError(name.at, f"a second field is called `{name.text}`")
                fields[name.text] = declared
                if default:
                    defaults.append((name.text, _default(default, declared)))
        self._take(";")
        kept = tuple(field for field in fields.items() if field[0] != EMPTY)
        self._made[full] = Structure(full, kept, tuple(defaults))
        self._places[full] = at

    def _declared(self, kind: DataType) -> Iterator[tuple[_Token, DataType]]:
        """The names that are declared of type ``kind``, and the type of each."""
        while True:
            name, declared = self._name(), kind
            if self._takes("["):
                if isinstance(kind, Array):
                    what = f"`{name.text}` is an array of arrays, which ROS 2 does not have"
                    raise _FaultError(name.at, what)
                declared = Array(kind, self._size(), True)
                self._take("]")
            yield name, declared
            if not self._takes(","):
                break
        self._take(";")

    def _constant(self) -> None:
        at = self._next.at
        kind = self._type()
        name = self._name()
        self._take("=")
        value: list[_Token] = []
        while self._next.text != ";" and self._next.kind != "end":
            value.append(self._take())
        self._take(";")
        if not isinstance(kind, Primitive):
            raise _FaultError(at, f"a constant cannot be of type {describe(kind)}")
        owner = self._full("").rstrip("/").removesuffix(_CONSTANTS)
        made = _value(value, kind, name.at)
        self._constants.setdefault(owner, []).append((name.text, kind.name, made))

    # --- types -------------------------------------------------------------------------------------

    def _size(self) -> int:
        token = self._next
        if token.kind != "number" or not token.text.isdecimal() or len(token.text) > 9:
            raise self._unexpected("a number of elements or characters")
        if not int(token.text):
            raise _FaultError(token.at, "ROS 2 has nothing of at most 0 elements or characters")
        return int(self._take().text)

    def _type(self) -> DataType:
        token = self._name()
        if token.text in self._texts:
            if self._takes("<"):
                self._size()
                self._take(">")
            return self._texts[token.text]
        if token.text == "sequence":
            return self._sequence(token)
        words = token.text
        while words in ("unsigned", "long", "unsigned long") and self._next.text in (
            *("short", "long", "double"),
        ):
            words += f" {self._take().text}"
        if words in _TYPES:
            return Primitive(_TYPES[words])
        while self._takes("::"):
            words += f"/{self._name().text}"
        return self._named(words, token.at)

    def _sequence(self, token: _Token) -> DataType:
        self._take("<")
        element = None if self._next.text == "sequence" else self._type()
        if element is None or isinstance(element, Array):
            raise _FaultError(
                token.at, "a sequence of sequences or arrays, which ROS 2 does not have"
            )
        most = self._size() if self._takes(",") else None
        self._take(">")
        return Array(element, most)

    def _named(self, name: str, at: Position) -> DataType:
        for depth in range(len(self._modules), -1, -1):
            full = "/".join((*self._modules[:depth], name))
            found = self._aliases.get(full) or self._made.get(full)
            if found is not None:
                return found
        in_package = [self._modules[0], "msg"] if self._modules else []
        try:
            return self._find(name if "/" in name else "/".join([*in_package, name]))
        except KeyError as error:
            raise _FaultError(at, str(error.args[0]), rule="unknown-type") from error


def _is_text(kind: DataType) -> bool:
    return kind in (Primitive("string"), Primitive("wstring"))


def _default(tokens: tuple[_Token, ...], kind: DataType) -> Value | tuple[Value, ...]:
    """What ``@default`` gives: of an array it is a text, ``"(1, 2)"``."""
    at = tokens[0].at
    if not isinstance(kind, Array):
        return _value(list(tokens), kind, at)
    written = "".join(token.text for token in tokens)
    inside = (text_value(written) or "").strip()
    items = f"[{inside[1:-1].rstrip().removesuffix(',')}]" if inside[:1] in "([" else inside
    made = parse_value(items, kind)
    if made is None:
        raise _FaultError(at, f"`{written[:80]}` is not a value of {describe(kind)}")
    return made


def _value(tokens: list[_Token], kind: DataType, at: Position) -> Value:
    made: Value | tuple[Value, ...] | None = None
    if tokens and all(token.kind == "text" for token in tokens):
        texts = [text_value(token.text.removeprefix("L")) for token in tokens]
        whole = "".join(text for text in texts if text is not None)
        made = whole if _is_text(kind) and None not in texts else None
    elif not _is_text(kind):
        written = "".join(token.text for token in tokens)
        made = parse_value(written, kind)
    if made is None or isinstance(made, tuple):
        shown = " ".join(token.text for token in tokens)[:80]
        raise _FaultError(at, f"`{shown}` is not a value of {describe(kind)}")
    return made
