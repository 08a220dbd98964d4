"""A leaf whose skill serves a tick service: a tick is a call of it."""

from __future__ import annotations

import logging

from m2c.policy.program import Leaf
from m2c.policy.ticking import STATUS_CODES, TreeNode
from m2c.policy.ticks import LeafTick
from m2c.runtime.messages import message_class
from transports.interface import CallOutcome, CallResult, Client, Service, Transport


class SkillLeaf:
    """Calls the tick service of ``leaf``, and its halt service where it has one.

    Args:
        leaf: whom to call.
        transport: the policy's connection.
        timeout_s: how long the skill may take to answer; it counts as FAILURE then.
        log: where failed calls are reported.
    """

    def __init__(
        self, leaf: Leaf, transport: Transport, timeout_s: float, log: logging.Logger
    ) -> None:
        assert leaf.tick_request is not None
        assert leaf.tick_response is not None
        self._leaf = leaf
        self._timeout_s = timeout_s
        self._log = log
        request = message_class(leaf.tick_request)
        response = message_class(leaf.tick_response)
        service = Service(leaf.tick, leaf.tick_type, request, response)
        self._request = request()
        self._client = transport.client(service)
        self._halt: Client | None = None
        if leaf.halt and leaf.halt_request is not None and leaf.halt_response is not None:
            self._halt_request = message_class(leaf.halt_request)()
            halt_response = message_class(leaf.halt_response)
            self._halt = transport.client(
                Service(leaf.halt, leaf.halt_type, type(self._halt_request), halt_response)
            )

    def tick(self, _: TreeNode, record: LeafTick) -> str:
        """SUCCESS, FAILURE or RUNNING."""
        leaf = self._leaf
        result = self._client.call_and_wait(self._request, self._timeout_s)
        if result.outcome is not CallOutcome.RESPONSE:
            why = _reason(leaf.tick, result)
            self._log.error("leaf %s: %s; taken as FAILURE", leaf.name, why)
            return "FAILURE"
        status = STATUS_CODES.get(result.response.status)
        if status is None:
            wrong = result.response.status
            self._log.error("leaf %s: %s answers status %s", leaf.name, leaf.tick, wrong)
            return "FAILURE"
        return status

    def halt(self, _: TreeNode, record: LeafTick) -> None:
        """Stop what is RUNNING."""
        if self._halt is None:
            return
        result = self._halt.call_and_wait(self._halt_request, self._timeout_s)
        if result.outcome is not CallOutcome.RESPONSE:
            why = _reason(self._leaf.halt, result)
            self._log.error("leaf %s: %s; it may still be running", self._leaf.name, why)


def _reason(channel: str, result: CallResult) -> str:
    """Which call failed and why; some transports' texts begin with the channel."""
    why = result.error or str(result.outcome)
    return why if why.startswith(channel) else f"{channel}: {why}"
