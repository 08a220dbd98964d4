"""What taps learn of messages that nodes take, and how far a node has reported.

A transport that does not report takes (``Listener.reports_takes``) says nothing of them, and answers None.
Every public function is a check.
"""

from __future__ import annotations

from functools import partial

from transports.conformance.stage import COUNT, NUMBERS, Number, on, ready
from transports.interface import Answer, Observation, ObservationKind, Publisher, Tap, Topic
from transports.networks import Network

ECHOES = Topic("/conformance/echoes", Number.__type_name__, Number)


class _Scene:
    """A node that publishes, one that takes that and publishes it again, and a tap."""

    def __init__(self, network: Network) -> None:
        self.network = network
        self.source, self.taker, self.listener = map(network.node, ("source", "taker", "listener"))
        self.received: list[Observation] = []
        self.numbers: Publisher = on(network, self.source, lambda: self.source.publisher(NUMBERS))
        echoes: Publisher = on(network, self.taker, lambda: self.taker.publisher(ECHOES))
        on(network, self.taker, lambda: self.taker.subscribe(NUMBERS, echoes.publish))
        self.tap: Tap = on(
            network, self.listener, lambda: self.listener.tap([], self.received.append)
        )
        ready(network, self.source, self.taker, self.listener)

    def of(self, kind: ObservationKind, channel: str) -> list[Observation]:
        """What was learned of this kind on ``channel``."""
        return [o for o in self.received if o.kind is kind and o.channel == channel]

    def pass_on(self, value: int) -> None:
        """Have a message published, and wait until the tap has received that of the taker."""
        on(self.network, self.source, partial(self.numbers.publish, Number(value)))
        assert self.network.until(
            lambda: any(
                o.data["value"] == value for o in self.of(ObservationKind.MESSAGE, ECHOES.name)
            )
        ), "the tap does not receive what the taker publishes"

    def begin(self) -> bool:
        """Until the taker reports what it takes, which it learns to do by and by; whether it does at all."""
        for value in range(20):
            self.pass_on(-1 - value)
            self.network.caller(lambda: self.source.wait_for_nodes(["nobody"], 0.1))()
            if self.of(ObservationKind.MESSAGE_TAKEN, NUMBERS.name):
                break
        else:
            assert not self.taker.reports_takes, "nothing is received of messages that are taken"
            return False
        assert self.taker.reports_takes, "messages taken are received though it reports none"
        self.received.clear()
        return True

    def ask(self, node: str) -> tuple[Answer | None, list[Observation]]:
        """The answer, and what had been received when it came."""
        answers: list[tuple[Answer | None, list[Observation]]] = []
        on(
            self.network,
            self.listener,
            lambda: self.tap.ask(node, lambda a: answers.append((a, self.received.copy()))),
        )
        assert self.network.until(lambda: bool(answers)), f"asking {node} does not end"
        assert len(answers) == 1, "a question is answered twice"
        return answers[0]


def a_tap_receives_which_messages_a_node_takes(network: Network) -> None:
    """Each once, by whose message it is and its number, before what the node does of it."""
    scene = _Scene(network)
    if not scene.begin():
        return
    for value in range(COUNT):
        scene.source.post(partial(scene.numbers.publish, Number(value, "x")))
    assert network.until(
        lambda: (
            len(scene.of(ObservationKind.MESSAGE_TAKEN, NUMBERS.name)) >= COUNT
            and len(scene.of(ObservationKind.MESSAGE, ECHOES.name)) >= COUNT
        )
    ), f"the tap received {len(scene.received)} observations of {3 * COUNT}"
    published = {o.sequence: o for o in scene.of(ObservationKind.MESSAGE, NUMBERS.name)}
    taken = scene.of(ObservationKind.MESSAGE_TAKEN, NUMBERS.name)
    assert [o.call for o in taken] == sorted(published), "not each message is taken once"
    first = taken[0].sequence
    assert [o.sequence for o in taken] == list(range(first, first + COUNT)), "numbers have gaps"
    echoes = scene.of(ObservationKind.MESSAGE, ECHOES.name)
    for take, echo in zip(taken, echoes, strict=True):
        message = published[take.call]
        assert (take.source, take.client) == ("taker", "source"), f"taken by or from whom: {take}"
        assert take.type_name == Number.__type_name__, f"type {take.type_name!r}"
        assert take.client_life == message.life, "taken from another life of its publisher"
        assert take.data is None, "the contents are reported twice"
        assert message.data == echo.data, f"{take} is of {message}, and makes {echo}"
        assert message.stamp_ns < take.stamp_ns < echo.stamp_ns, "taken too early or too late"
        assert take.order < echo.order, "taken after what came of it"


def an_answer_comes_behind_what_it_speaks_of(network: Network) -> None:
    """All that has a number below it has been received, and nothing else was done until its stamp."""
    scene = _Scene(network)
    if not scene.begin():
        return
    asked: list[tuple[Answer, list[Observation]]] = []
    for value in range(20):
        for part in range(10):
            scene.source.post(partial(scene.numbers.publish, Number(10 * value + part)))
        if value % 2:
            scene.pass_on(1000 + value)
        answer, received = scene.ask("taker")
        assert answer is not None, "a node that is there does not answer"
        asked.append((answer, received))
    scene.pass_on(2000)
    done = sorted((o for o in scene.received if o.source == "taker"), key=lambda o: o.order)
    for answer, received in asked:
        before = [o for o in done if o.order < answer.next_order]
        missing = [o for o in before if o not in received]
        assert not missing, f"{answer} came before {len(missing)} that it speaks of: {missing[:1]}"
        early = [o for o in done if o.stamp_ns <= answer.stamp_ns and o not in before]
        assert not early, f"{answer} does not speak of {early[:1]}, which was done before"
    stamps = [answer.stamp_ns for answer, _ in asked]
    assert stamps == sorted(stamps), "a later answer is about less"
    last = asked[-1][0]
    assert last.next_order > done[0].order, "answers are never about anything that was done"


def who_is_not_there_does_not_answer(network: Network) -> None:
    """None: for a name that nobody has, and for a node that is closed."""
    scene = _Scene(network)
    answer, _ = scene.ask("source")
    assert (answer is not None) is scene.taker.reports_takes, f"it answers {answer}"
    assert scene.ask("nobody")[0] is None, "a node that is not there answers"
    gone: list[str] = []
    on(
        network,
        scene.listener,
        lambda: scene.listener.watch_nodes(lambda name, up: None if up else gone.append(name)),
    )
    scene.source.close()
    assert network.until(lambda: "source" in gone), "it is not seen that a node is closed"
    assert scene.ask("source")[0] is None, "a node that is closed answers"
