"""What generated Python consists of, compared with that of a twin whose names are harmless.

The twin's code is the generator's own: of all that a model gives, it has names that are recognised
(:data:`tests.hostile.models.HARMLESS`). So the hostile code must have as many nodes of each kind,
call and import the same, and differ in identifiers only where the twin's come from the model.
"""

from __future__ import annotations

import ast
import builtins
import io
import re
import tokenize
import warnings
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import lru_cache
from pathlib import PurePosixPath

import msgspec

from tests.hostile.models import HARMLESS
from tests.hostile.texts import MARK

_ANY = "*"
_IDENTIFIER = re.compile(r"\w+")


class Profile(msgspec.Struct):
    """What all files of one role consist of (every ``machine.py``; every ``node.py``)."""

    nodes: Counter[str] = msgspec.field(default_factory=Counter)
    calls: Counter[str] = msgspec.field(default_factory=Counter)
    imports: Counter[str] = msgspec.field(default_factory=Counter)
    names: Counter[str] = msgspec.field(default_factory=Counter)
    globals: set[str] = msgspec.field(default_factory=set)
    constants: set[object] = msgspec.field(default_factory=set)


def profiles(files: Mapping[str, str], roles: Iterable[str] = ()) -> dict[str, Profile]:
    """The profile of each role that Python files have.

    Args:
        files: path → text.
        roles: the twin's; a file called otherwise is one that is called after the model. Without
            them it is the twin that is described: with a star for each identifier of the model's.

    Raises:
        AssertionError: a file does not compile without a warning, or has an identifier that is not
            ASCII, a name that nothing binds, or a payload in a comment.
    """
    known = set(roles)
    found: dict[str, Profile] = {}
    for path, text in files.items():
        if path.endswith(".py"):
            one = _profile(path, text, str if known else _masked)
            _add(found.setdefault(_role(path, known), Profile()), one)
    return found


@lru_cache(maxsize=4096)
def _profile(path: str, text: str, shown: Callable[[str], str]) -> Profile:
    """Of one file. Most of a system is the same in either packaging, and whatever one name is."""
    tree = _compiled(path, text)
    _check_comments(path, text)
    return _profiled(path, tree, shown)


def _add(profile: Profile, one: Profile) -> None:
    for name in Profile.__struct_fields__:
        getattr(profile, name).update(getattr(one, name))


def differences(hostile: Mapping[str, Profile], twin: Mapping[str, Profile]) -> list[str]:
    """What the hostile code has and the twin's has not, or the other way round, in words."""
    found = [
        f"files: {sorted(hostile)} instead of {sorted(twin)}"
        for _ in [0]
        if set(hostile) != set(twin)
    ]
    for role in sorted(set(hostile) & set(twin)):
        one, other = hostile[role], twin[role]
        if one.nodes != other.nodes:
            found.append(f"{role}: kinds of nodes {_both(one.nodes, other.nodes)}")
        for what in ("calls", "imports", "names"):
            found += [
                f"{role}: {what}: {line}"
                for line in _unexplained(getattr(one, what), getattr(other, what))
            ]
        strange = one.globals - other.globals
        if strange:
            found.append(f"{role}: builtins {sorted(strange)}")
    return found


def _both(one: Counter[str], other: Counter[str]) -> str:
    return f"+{dict(one - other)} -{dict(other - one)}"


def _role(path: str, known: set[str]) -> str:
    """A file by its name and depth; one that is called after the model by its ending."""
    parts = PurePosixPath(path).parts
    role = f"{len(parts)}:{parts[-1]}"
    derived = HARMLESS in parts[-1] or (known and role not in known)
    return f"{len(parts)}:{_ANY}{''.join(PurePosixPath(path).suffixes[-2:])}" if derived else role


def _compiled(path: str, text: str) -> ast.Module:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            text.encode()
            compile(text, path, "exec", dont_inherit=True)
        except (SyntaxError, ValueError, SyntaxWarning, DeprecationWarning) as error:
            raise AssertionError(f"{path} does not compile: {error!r}") from error
    return _unrenamed(ast.parse(text))


def _unrenamed(tree: ast.Module) -> ast.Module:
    """``tree`` as if no field of a message were a word of Python: ``class_: int = msgspec.field(default=0,
    name="class")`` is what the generator writes for ``class: int = 0``.
    """
    for node in ast.walk(tree):
        match node:
            case ast.AnnAssign(
                target=ast.Name(id=attribute),
                value=ast.Call(
                    func=ast.Attribute(value=ast.Name(id="msgspec"), attr="field") as function,
                    args=[],
                    keywords=[
                        made,
                        ast.keyword(arg="name", value=ast.Constant(value=str() as name)),
                    ],
                ),
            ) if attribute == f"{name}_":
                factory = ast.Call(function, [], [made])
                node.value = made.value if made.arg == "default" else factory
    used = any(isinstance(node, ast.Name) and node.id == "msgspec" for node in ast.walk(tree))
    if not used:
        tree.body = [
            node
            for node in tree.body
            if not (isinstance(node, ast.Import) and node.names[0].name == "msgspec")
        ]
    return tree


def _check_comments(path: str, text: str) -> None:
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT:
            assert MARK not in token.string, f"{path}: a payload in the comment {token.string!r}"
        if token.type == tokenize.NAME:
            assert token.string.isascii(), f"{path}: the identifier {token.string!r}"


def _profiled(path: str, tree: ast.Module, shown: Callable[[str], str]) -> Profile:
    profile = Profile()
    bound = set(_bound(tree))
    for node in ast.walk(tree):
        profile.nodes[type(node).__name__] += 1
        match node:
            case ast.Call(func=target):
                profile.calls[shown(ast.unparse(target)) if _is_path(target) else "…"] += 1
            case ast.Import(names=names):
                profile.imports.update(shown(item.name) for item in names)
            case ast.ImportFrom(module=module, names=names):
                profile.imports.update(shown(f"{module}.{item.name}") for item in names)
            case ast.Constant(value=value):
                profile.constants.add(value)
            case _:
                pass
        profile.names.update(shown(name) for name in _identifiers(node))
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load) and node.id not in bound:
            assert hasattr(builtins, node.id), f"{path}: nothing binds `{node.id}`"
            profile.globals.add(node.id)
    return profile


def _is_path(target: ast.expr) -> bool:
    while isinstance(target, ast.Attribute):
        target = target.value
    return isinstance(target, ast.Name)


def _masked(text: str) -> str:
    """``text`` with a star for each identifier that a harmless name of the model became."""
    return _IDENTIFIER.sub(lambda word: _ANY if HARMLESS in word[0].lower() else word[0], text)


def _identifiers(node: ast.AST) -> Iterator[str]:
    match node:
        case ast.Name(id=name) | ast.Attribute(attr=name) | ast.arg(arg=name):
            yield name
        case ast.FunctionDef(name=name) | ast.ClassDef(name=name):
            yield name
        case ast.keyword(arg=name) if name is not None:
            yield name
        case ast.Global() | ast.Nonlocal():
            yield from node.names


def _bound(tree: ast.Module) -> Iterator[str]:
    for node in ast.walk(tree):
        match node:
            case ast.Name(id=name, ctx=ast.Store()) | ast.arg(arg=name):
                yield name
            case ast.FunctionDef(name=name) | ast.ClassDef(name=name):
                yield name
            case ast.ExceptHandler(name=str() as name):
                yield name
            case ast.alias(name=name, asname=alias):
                yield alias or name.partition(".")[0]
    yield from ("__name__", "__file__")


def _unexplained(hostile: Counter[str], twin: Counter[str]) -> Iterator[str]:
    """What is in the one and not in the other, once each star of the twin stands for a name."""
    own = Counter({text: count for text, count in twin.items() if _ANY not in text})
    for text, count in (own - hostile).items():
        yield f"`{text}` {count} times less"
    patterns = [
        re.compile(re.escape(text).replace(re.escape(_ANY), r"\w+"))
        for text in twin
        if _ANY in text
    ]
    left = hostile - own
    for text in left:
        if not any(pattern.fullmatch(text) for pattern in patterns):
            yield f"`{text}`"
    expected = sum(twin.values()) - sum(own.values())
    if sum(left.values()) != expected:
        yield f"{sum(left.values())} of the model's, instead of {expected}"
