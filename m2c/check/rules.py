"""Every rule of the check: its name, how bad it is, and what it means.

``docs/rules.md`` shows this table with an example each; SARIF output carries it.
"""

from __future__ import annotations

import msgspec

from m2c.diagnostics import Severity


class Rule(msgspec.Struct, frozen=True):
    """One rule; ``meaning`` says in a clause what a finding of it tells."""

    id: str
    severity: Severity
    meaning: str


def _table(severity: Severity, meanings: dict[str, str]) -> tuple[Rule, ...]:
    return tuple(Rule(name, severity, meaning) for name, meaning in meanings.items())


_ERRORS = {
    # files
    "unreadable-file": "the file cannot be read",
    "malformed-xml": "the file is not XML",
    "malformed-json": "the file is not JSON",
    "hostile-xml": "the file is too large or too deep, or declares a document type",
    "no-models": "a folder holds no model",
    "mixed-input": "a system file was given together with other files",
    "missing-file": "a file or folder that is referred to does not exist",
    "missing-element": "a full model lacks its `<model>`, or a history or an `<initial>` its transition",
    "duplicate-policy": "a system has more than one behaviour tree",
    "bad-parameter": "a parameter of the system with a value that it cannot have",
    "bad-deployment": "a deployment that forgets a node, names one twice, or says something that is not so",
    "bad-quality": "a quality of a topic that is none",
    "duplicate-quality": "the qualities of a topic are given twice",
    "unknown-topic": "qualities are given for a topic that no model has",
    # structure
    "unknown-tag": "an element that the language does not have, or not here",
    "unknown-attribute": "an attribute that the element does not have",
    "missing-attribute": "an attribute that the element must have",
    "unsupported-element": "an element of SCXML that is not part of the language",
    "no-states": "a machine without states",
    "bad-name": "a name that is too long, cannot be seen or written, or that the middleware does not take",
    "duplicate-state": "two states of one name",
    "duplicate-data": "two variables of one name",
    "duplicate-interface": "two interfaces of one kind and name",
    "duplicate-field": "a field is set twice in one message",
    "unknown-target": "a transition or the start leads to a state that does not exist, or is elsewhere",
    "undeclared-interface": "a handler or output refers to an interface that is not declared",
    "undeclared-port": "a port of the behaviour tree that the plugin does not declare",
    "unknown-child": "a child of a plugin that is neither a number nor an integer variable",
    "bad-duration": "a delay that is not a CSS time",
    "bad-rate": "a rate that is not a number greater than 0",
    "bad-number": "a number of threads that is not a whole number from 1",
    "thread-event": "an action thread waits for an event that only the machine around it gets",
    "bad-probability": "probabilities that are none, or do not add up to 1",
    "bad-status": "a status that a tree's node cannot return",
    "unbound-event": "plain SCXML: an event names a channel whose type is not known",
    "unsupported-event": "a plain event of other machines is sent with a delay, or taken by an action thread",
    "event-param-types": "senders of a plain event give a param types that do not go together",
    "untyped-event-param": "a param of a plain event has a type that is not known",
    # expressions
    "bad-expression": "the text is not an ECMAScript expression",
    "unsupported-expression": "ECMAScript outside the sub-language",
    "bad-location": "what is assigned to is not a variable, or a field or element of one",
    "undeclared-variable": "a variable that the datamodel does not have",
    "event-data-not-available": "event data is read where no event brings it",
    "unknown-field": "a field that the message type does not have",
    "type-mismatch": "types that do not go together",
    "out-of-range": "a number that its type cannot hold, an element that an array does not have, or a wrong "
    "number of them",
    "bad-initial-value": "an initial value that its variable cannot hold, or that may fail",
    # interface definitions
    "unknown-type": "a type that no definition gives, or one of another kind",
    "bad-interface": "an interface definition that cannot be read",
    "bad-structure": "a declaration of data structures that cannot be read",
    "duplicate-type": "two data structures of one name",
    "recursive-type": "a type contains itself",
    "tick-contract": "the type of a tick's service says something else than a policy understands",
    # systems
    "bad-override": "--param or --remap says something of no node, or cannot be read",
    "unknown-parameter": "an instance gives a value or a channel that its model does not have",
    "duplicate-parameter": "an instance gives a value or a channel twice",
    "duplicate-node": "two nodes or plugins of one name, or a plugin named as a node of BehaviorTree.CPP",
    "duplicate-server": "two nodes serve one service or action",
    "type-disagreement": "two machines declare one channel with different types",
    # behaviour trees
    "missing-tree": "the policy has no tree, or not the one to execute",
    "duplicate-tree": "two trees of one name",
    "missing-subtree": "a sub-tree that the policy does not define",
    "recursive-subtree": "a sub-tree contains itself",
    "recursive-include": "a policy includes itself",
    "deep-include": "a policy includes files more than 16 deep",
    "deep-tree": "a tree with its sub-trees is more than 256 nodes deep",
    "large-tree": "a tree with its sub-trees has more than 100,000 nodes",
    "unknown-node": "an element of the tree that is neither a control node nor a leaf",
    "unknown-port": "an attribute that the tree's node does not have",
    "bad-port": "a port of the tree's node has a value that it cannot have",
    "unset-entry": "a node reads an entry of the blackboard that nothing in the policy sets",
    "child-count": "a tree's node has too few or too many children",
    "leaf-address": "a leaf does not say which service answers its ticks",
    "leaf-port": "a port of a leaf is not given, or not in a way that it can be",
    "leaf-type": "a leaf's service has a type that cannot answer a tick",
    "refused-policy": "BehaviorTree.CPP does not load the policy",
}

_WARNINGS = {
    "request-discarded": "a state in which nothing takes a request that the machine serves",
    "request-unanswered": "a request, goal or tick is taken, and no path ever answers it",
    "response-without-request": "a response that no request waits for: a second one, or one of no request",
    "goal-failure-unhandled": "a state waits for a goal, and nothing ends that if the goal's server dies",
    "unreachable-state": "no run enters the state",
    "shadowed-transition": "an earlier transition always takes this one's turn",
    "never-taken": "the transition's condition never holds",
    "eventless-cycle": "transitions without events follow each other for ever",
    "unread-input": "an interface brings something that no state handles",
    "unused-interface": "an interface is declared and never used",
    "lenient-conversion": "with `--lenient`: a string, number or bool becomes another of them",
    "missing-package": "an interface package that nodes on ROS 2 need is not installed",
    "differing-definition": "two folders define a type differently; the one that comes first is used",
    "unset-output-field": "a field of a message is sent as zero or empty",
    "nobody-serves": "the other end of a channel is missing (in a system), or misspelt (in a folder)",
    "unknown-machine": "an event is sent to a machine that was not read",
    "undeclared-function": "a channel that the interface list does not have",
    "undeclared-list-entry": "the full model refers to an interface that the list does not have",
    "function-kind": "a channel is a topic here and a service there",
    "duplicate-input": "a model is listed twice",
    "unportable-name": "a name that a transport does not take, on which the nodes might run",
    "path-case": "a path differs from the one on disk by case",
    "xml-prologue": "blank lines before the XML declaration",
    "xml-namespace": "the namespace is not SCXML's",
    "braced-entry": "an entry's name stands in braces where BehaviorTree.CPP takes it without",
    "leaf-kind": "a leaf is written as a condition and served as an action, or the other way round",
    "output-read": "a plugin reads one of its output ports",
    "ignored-attribute": "an attribute that is ignored: none of a leaf's ports, or like one that is read",
    "unset-port": "a plugin's port reads an entry of the blackboard that nothing sets",
    "unserved-leaf": "no node of the system answers the leaf's ticks",
}

_NOTES = {
    "older-spelling": "an older or foreign spelling, and what it is read as",
    "ignored-element": "an element that another tool reads",
    "provided-topic": "a topic that m2c adds a node for",
    "monitored-leaf": "the mark of the earlier monitor is ignored",
    "policy-alone": "a policy was checked without its system",
    "tree-beside": "a sub-tree is taken from a file of the folder that is not included",
    "empty-port": "an empty port counts as not given",
}

RULES: tuple[Rule, ...] = (
    *_table(Severity.ERROR, _ERRORS),
    *_table(Severity.WARNING, _WARNINGS),
    *_table(Severity.NOTE, _NOTES),
)
"""Every rule, errors first, in the order of the reading."""
