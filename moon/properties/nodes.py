"""The update rules of the nodes that remember: their variables, and Python text that brings them to ``t``.

In the text ``#`` stands for the node's number, ``<P>`` and ``<Q>`` for its inputs' values, ``<A>`` and
``<B>`` for its bounds. Each rule is constant work (amortised over the intervals that it drops).
"""

from __future__ import annotations

from textwrap import indent

from moon.properties.network import IN_STEPS, Network, Node

NEVER = 1 << 70
"""Later than every stamp; sums with bounds stay later."""

_STATE = {
    "ever": ("l",),
    "lower": ("l",),
    "upper": ("c", "l", "e"),
    "both": ("c", "l", "s", "q"),
    "since": ("s",),
    "since_lower": ("l", "z"),
    "since_upper": ("c", "z", "l", "e"),
    "since_both": ("c", "z", "l", "s", "q"),
}
_STATE |= {f"{name}_steps": _STATE[name] for name in _STATE if name.startswith("since")}
INITIAL = {
    **{"c": "False", "z": "False", "v": "False", "e": "-1", "q": "deque()"},
    "l": str(NEVER),
    "s": "False",
}


def mode(node: Node) -> str:
    """Which of the update rules a remembering node follows."""
    lower, upper = node.interval.lower, node.interval.upper
    if node.kind == "once":
        if upper is None:
            return "lower" if lower else "ever"
        return "both" if lower else "upper"
    steps = "_steps" if node.text == IN_STEPS else ""
    if upper is None:
        return ("since_lower" if lower else "since") + steps
    return ("since_both" if lower else "since_upper") + steps


def state_names(index: int, node: Node) -> tuple[str, ...]:
    """The variables of a remembering node."""
    return tuple(f"{letter}{index}" for letter in _STATE[mode(node)])


def stays_false(network: Network, root: int) -> bool:
    """Whether the root, once false, stays false: it says that something has never happened."""
    node = network.nodes[root]
    if node.kind == "constant":
        return True
    if node.kind == "and":
        return all(stays_false(network, item) for item in node.inputs)
    if node.kind != "not":
        return False
    inner = network.nodes[node.inputs[0]]
    return inner.kind == "once" and mode(inner) in ("ever", "lower")


_SPELLS = """\
if <P>:
    if not c#:
        c# = True
        l# = t
        if q# and q#[-1][1] >= t + <A>:
            s# = q#.pop()[0]
        else:
            s# = t + <A>
            heappush(heap, (s#, #))
elif c#:
    c# = False
    q#.append((s#, (t if t > l# else t + 1) + <B>))
    heappush(heap, (q#[-1][1], #))
"""
"""Where a spell of ``<P>`` begins or ends; ``q#`` keeps from when until when each is in the bounds."""

_IN_BOUNDS = """\
while q# and q#[0][1] <= t:
    q#.popleft()
v# = q#[0][0] <= t if q# else c# and s# <= t
"""
"""Whether one of them is, now."""

UPDATES = {
    "ever": """
if l# == <NEVER> and <P>:
    l# = t
""",
    "lower": """
if l# == <NEVER> and <P>:
    l# = t
    heappush(heap, (t + <A>, #))
v# = t >= l# + <A>
""",
    "upper": """
if <P>:
    if not c#:
        c# = True
        l# = t
    v# = True
else:
    if c#:
        c# = False
        e# = (t if t > l# else t + 1) + <B>
        if e# > t:
            heappush(heap, (e#, #))
    v# = t < e#
""",
    "both": "\n" + _SPELLS + _IN_BOUNDS,
    "since": """
h = <P>
s# = <Q> or (h and s#)
v# = h and s#
""",
    "since_lower": """
if <P>:
    if l# == <NEVER> and (z# or <Q>):
        l# = t
        heappush(heap, (t + <A>, #))
    z# = False
    v# = t >= l# + <A>
else:
    l# = <NEVER>
    z# = <Q>
    v# = False
""",
    "since_upper": """
if <P>:
    if <Q>:
        if not c#:
            c# = True
            l# = t
        v# = True
    else:
        if c#:
            c# = False
            e# = (t if t > l# else t + 1) + <B>
            if e# > t:
                heappush(heap, (e#, #))
        elif z#:
            e# = t + <B>
            if e# > t:
                heappush(heap, (e#, #))
        v# = t < e#
    z# = False
else:
    c# = False
    z# = <Q>
    e# = -1
    v# = False
""",
    "since_both": "\nif <P>:\n"
    + indent(_SPELLS.replace("<P>", "<Q>"), "    ")
    + """    elif z# and <A> < <B>:
        q#.append((t + <A>, t + <B>))
        heappush(heap, (t + <A>, #))
        heappush(heap, (t + <B>, #))
    z# = False
"""
    + indent(_IN_BOUNDS, "    ")
    + """else:
    q#.clear()
    c# = False
    z# = <Q>
    v# = False
""",
}
"""Per mode, what brings a node to ``t``; ``v#`` (or what is read instead) is its value then."""

# In discrete time ``since`` has its usual meaning: an instant of the right side counts itself, whether
# or not the left side holds there.
UPDATES |= {
    "since_steps": UPDATES["since"].replace("v# = h and s#", "v# = s#"),
    "since_lower_steps": """
if <P>:
    if l# == <NEVER> and (z# or <Q>):
        l# = t - 1 if z# else t
        heappush(heap, (l# + <A>, #))
    z# = False
    v# = t >= l# + <A>
else:
    l# = <NEVER>
    z# = <Q>
    v# = False
""",
    "since_upper_steps": UPDATES["since_upper"].replace("v# = False", "v# = z#"),
    "since_both_steps": UPDATES["since_both"]
    .replace(
        """            else:
                s# = t + <A>
""",
        """            else:
                s# = t - 1 + <A> if z# else t + <A>
""",
    )
    .replace("z# and <A> < <B>", "z#")
    .replace("q#.append((t + <A>, t + <B>))", "q#.append((t - 1 + <A>, t + <B>))")
    .replace(
        "heappush(heap, (t + <A>, #))\n        heappush(heap, (t + <B>",
        "heappush(heap, (t - 1 + <A>, #))\n        heappush(heap, (t + <B>",
    ),
}
