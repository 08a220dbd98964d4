"""Nodes of one process in one rclpy context, for tests of who did what: ``ros2_composed_peer.py left|right``.

Each line on stdin has them do something: ``act`` all say, call and send goals to the servers of both
processes; ``close NAME`` closes a node alone. Each is answered by a line when it is done.
"""

import sys
import threading

from tests.transports import ros2_network
from transports.conformance import DOUBLE, NUMBERS, Answer, Ask, Number
from transports.conformance.stage import COUNTING, Text
from transports.interface import Action, CallOutcome, GoalEvents, Service
from transports.ros2 import connect
from transports.work_queue import WorkQueue

PROCESSES = ("left", "right")
KINDS = ("owner", "server", "one", "two")
NODES = [f"{process}_{kind}" for process in PROCESSES for kind in KINDS]
CALLERS = [name for name in NODES if name.endswith(("one", "two"))]
CALLS = 5
FAILS = 3
"""The number of the call that a server fails, of those whose caller is called two."""
TAPPER = "tapper"
WAIT_S = 60.0


def double(process: str) -> Service:
    return Service(f"/{process}/double", DOUBLE.type_name, DOUBLE.request, DOUBLE.response)


def counting(process: str) -> Action:
    return Action(
        f"/{process}/count", COUNTING.type_name, COUNTING.goal, COUNTING.result, COUNTING.feedback
    )


def asked(caller: str, number: int) -> int:
    """What ``caller`` asks in its call ``number``."""
    return NODES.index(caller) * 100 + number


def caller_of(value: int) -> str:
    return NODES[value // 100]


def is_failed(value: int) -> bool:
    return caller_of(value).endswith("two") and value % 100 == FAILS


def run(process: str) -> None:
    owner = connect(f"{process}_owner", {})
    nodes = {owner.node: owner}
    for name in NODES:
        if name.startswith(process) and name != owner.node:
            nodes[name] = owner.beside(name)
    publishers = {name: node.publisher(NUMBERS) for name, node in nodes.items()}
    server = nodes[f"{process}_server"]

    def answer(request):
        value = request.data.value
        if request.client != caller_of(value):
            request.fail(f"{caller_of(value)} is taken for {request.client}")
        elif is_failed(value):
            request.fail("as it was told to")
        else:
            request.respond(Answer(2 * value))

    def pursue(handle):
        handle.accept()
        handle.publish_feedback(Number(1, handle.goal.text))
        handle.succeed(Text(handle.goal.text))

    server.serve(double(process), answer)
    server.serve_action(counting(process), pursue, lambda handle: None)
    callers = {name: node for name, node in nodes.items() if name in CALLERS}
    clients = {
        name: [node.client(double(other)) for other in PROCESSES] for name, node in callers.items()
    }
    goal_clients = {
        name: [node.action_client(counting(other)) for other in PROCESSES]
        for name, node in callers.items()
    }

    def act(name: str) -> None:
        for number in range(1, CALLS + 1):
            publishers[name].publish(Number(number, name))
        for client in clients.get(name, ()):
            for number in range(1, CALLS + 1):
                value = asked(name, number)
                result = client.call_and_wait(Ask(value), WAIT_S)
                if is_failed(value):
                    assert result.outcome is CallOutcome.REMOTE_ERROR, result
                    assert "as it was told to" in result.error, result
                else:
                    assert result.response == Answer(2 * value), (name, result)
        for client in goal_clients.get(name, ()):
            results = WorkQueue()
            events = GoalEvents(
                accepted=lambda goal_id: None,
                rejected=results.put,
                feedback=lambda goal_id, message: None,
                result=lambda goal_id, status, message, put=results.put: put(message),
                failed=lambda goal_id, result, put=results.put: put(result),
            )
            client.send_goal(Number(0, name), events, WAIT_S)
            result = results.get(timeout=WAIT_S)
            assert result == Text(name), (name, result)

    for node in nodes.values():
        threading.Thread(target=node.spin, name=node.node, daemon=True).start()
        node.post(node.announce)
    for node in nodes.values():
        assert not node.wait_for_nodes([TAPPER, *NODES], WAIT_S)
    print("up", flush=True)
    for line in sys.stdin:
        if line == "act\n":
            errors: list[BaseException] = []

            def acting(name: str, errors: list[BaseException] = errors) -> None:
                try:
                    act(name)
                except AssertionError as error:
                    errors.append(error)

            threads = [threading.Thread(target=acting, args=(name,)) for name in nodes]
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join()
            print(f"acted {errors}", flush=True)
        else:
            name = line.split()[1]
            nodes.pop(name).close()
            print("closed", flush=True)
    owner.close()


if __name__ == "__main__":
    ros2_network.load(ros2_network.built())
    run(sys.argv[1])
