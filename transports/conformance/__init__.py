"""The conformance suite: what every transport must do, as checks that any of them can be put to.

A check is a function of a :class:`~transports.networks.Network` that raises AssertionError, saying
what is wrong. With pytest::

    @pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
    def test_my_transport(check):
        network = ThreadedNetwork(lambda name, others: connect(name, {...}))
        try:
            check(network)
        finally:
            network.close()
"""

from __future__ import annotations

import inspect
from types import ModuleType

from transports.conformance import actions, ends, life, observation, services, takes, topics
from transports.conformance.actions import (
    a_cancel_request_reaches_the_goal_it_names,
    a_goal_can_be_rejected_or_aborted,
    a_goal_runs_from_acceptance_by_feedback_to_its_result,
    a_goal_that_nobody_serves_fails_once,
)
from transports.conformance.ends import a_goal_whose_server_ends_fails_once
from transports.conformance.life import (
    a_node_beside_another_has_a_life_of_its_own,
    a_node_is_up_once_it_is_announced_and_down_once_it_is_closed,
    callbacks_run_one_at_a_time,
    closing_while_busy_ends_everything,
    timers_fire_no_earlier_than_asked_and_stop_when_cancelled,
)
from transports.conformance.observation import (
    a_call_that_nobody_serves_is_stamped_when_it_was_made,
    a_tap_knows_in_what_order_a_source_did_things,
    a_tap_receives_every_message_once_and_in_order,
    a_tap_receives_how_a_call_failed,
    a_tap_receives_only_what_its_globs_name,
    a_tap_receives_the_four_events_of_every_call,
    a_tap_that_is_closed_receives_no_more,
)
from transports.conformance.services import (
    a_call_gets_its_own_answer_even_when_answers_are_deferred,
    a_call_that_nobody_serves_is_unavailable_or_times_out,
    a_call_without_an_answer_times_out_once,
    a_caller_may_wait_on_a_thread_of_its_own,
    a_remote_error_carries_its_text,
    a_request_is_answered_once,
    a_service_is_served_once_in_a_node,
)
from transports.conformance.stage import (
    COUNT,
    COUNTING,
    DOUBLE,
    NUMBERS,
    TRANSIENT_LOCAL,
    Answer,
    Ask,
    Check,
    Goal,
    Number,
    Text,
    calls,
    on,
    ready,
    refused,
)
from transports.conformance.takes import (
    a_tap_receives_which_messages_a_node_takes,
    an_answer_comes_behind_what_it_speaks_of,
    who_is_not_there_does_not_answer,
)
from transports.conformance.topics import (
    a_message_of_another_type_is_refused_by_its_publisher,
    a_message_that_is_not_of_the_topics_type_is_dropped_and_the_node_lives,
    a_transient_local_topic_gives_the_last_message_to_who_comes_late,
    messages_of_one_source_arrive_in_order,
)


def _checks_of(theme: ModuleType) -> list[Check]:
    return [
        value
        for name, value in vars(theme).items()
        if inspect.isfunction(value)
        and value.__module__ == theme.__name__
        and not name.startswith("_")
    ]


CHECKS: list[Check] = [
    check
    for theme in (topics, services, actions, life, observation, takes)
    for check in _checks_of(theme)
]
"""Every check: a transport conforms if it passes them all."""

CHECKS_OF_ENDS: list[Check] = _checks_of(ends)
"""Those that a transport passes, too, whose middleware knows when a server ends. With another, who waits
for a server that has ended waits until its time limit."""

__all__ = [
    "CHECKS",
    "CHECKS_OF_ENDS",
    "COUNT",
    "COUNTING",
    "DOUBLE",
    "NUMBERS",
    "TRANSIENT_LOCAL",
    "Answer",
    "Ask",
    "Check",
    "Goal",
    "Number",
    "Text",
    "a_call_gets_its_own_answer_even_when_answers_are_deferred",
    "a_call_that_nobody_serves_is_stamped_when_it_was_made",
    "a_call_that_nobody_serves_is_unavailable_or_times_out",
    "a_call_without_an_answer_times_out_once",
    "a_caller_may_wait_on_a_thread_of_its_own",
    "a_cancel_request_reaches_the_goal_it_names",
    "a_goal_can_be_rejected_or_aborted",
    "a_goal_runs_from_acceptance_by_feedback_to_its_result",
    "a_goal_that_nobody_serves_fails_once",
    "a_goal_whose_server_ends_fails_once",
    "a_message_of_another_type_is_refused_by_its_publisher",
    "a_message_that_is_not_of_the_topics_type_is_dropped_and_the_node_lives",
    "a_node_beside_another_has_a_life_of_its_own",
    "a_node_is_up_once_it_is_announced_and_down_once_it_is_closed",
    "a_remote_error_carries_its_text",
    "a_request_is_answered_once",
    "a_service_is_served_once_in_a_node",
    "a_tap_knows_in_what_order_a_source_did_things",
    "a_tap_receives_every_message_once_and_in_order",
    "a_tap_receives_how_a_call_failed",
    "a_tap_receives_only_what_its_globs_name",
    "a_tap_receives_the_four_events_of_every_call",
    "a_tap_receives_which_messages_a_node_takes",
    "a_tap_that_is_closed_receives_no_more",
    "a_transient_local_topic_gives_the_last_message_to_who_comes_late",
    "an_answer_comes_behind_what_it_speaks_of",
    "callbacks_run_one_at_a_time",
    "calls",
    "closing_while_busy_ends_everything",
    "messages_of_one_source_arrive_in_order",
    "on",
    "ready",
    "refused",
    "timers_fire_no_earlier_than_asked_and_stop_when_cancelled",
    "who_is_not_there_does_not_answer",
]
