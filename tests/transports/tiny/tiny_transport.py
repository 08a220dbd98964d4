"""A transport of somebody else: nodes in one process, a queue each. It knows only the interface."""

import fnmatch
import heapq
import itertools
import queue
import threading
import time

import msgspec

from transports import actions
from transports.interface import (
    CallOutcome,
    CallResult,
    Observation,
    ObservationKind,
    TransportError,
)

_NODES = {}
_TRANSIENT_LOCAL = {}
_LOCK = threading.RLock()


def connect(node, options):
    if options:
        raise TransportError(f"the tiny transport has no option `{next(iter(options))}`")
    return Tiny(node)


def refusal(kind, name):
    """Tiny nodes have tiny names."""
    if kind == "node" and len(name) > 8:
        return f"it has {len(name)} characters", name[:8]
    return None


def _typed(message, kind, type_name):
    if not isinstance(message, kind):
        raise TransportError(f"expected a message of type {type_name}")
    return msgspec.structs.replace(message)


class _Timer:
    def __init__(self, period, handler):
        self.period, self.handler = period, handler

    def cancel(self):
        self.handler = None


class _Completion:
    def __init__(self):
        self._ready, self._value = threading.Event(), None

    def set(self, value):
        if not self._ready.is_set():
            self._value = value
            self._ready.set()

    def wait(self, timeout_s):
        self._ready.wait(timeout_s)
        return self._value


class _Publisher:
    def __init__(self, node, topic):
        self._node, self._topic = node, topic

    def publish(self, message):
        topic = self._topic
        message = _typed(message, topic.message, topic.type_name)
        if topic.transient_local:
            _TRANSIENT_LOCAL[topic.name] = message
        for node in tuple(_NODES.values()):
            for other, handler in node.subscribed:
                if other.name == topic.name and other.type_name == topic.type_name:
                    node.post(lambda h=handler: h(message))
        self._node.tell(topic.name, ObservationKind.MESSAGE, topic.type_name, message)


class _Request:
    def __init__(self, server, service, data, client, call, end):
        self.data, self.client = data, client
        self._server, self._service, self._call, self._end = server, service, call, end

    def respond(self, response):
        response = _typed(response, self._service.response, self._service.type_name)
        self._finish(CallResult(CallOutcome.RESPONSE, response))

    def fail(self, error):
        self._finish(CallResult(CallOutcome.REMOTE_ERROR, error=error))

    def _finish(self, result):
        end, self._end = self._end, None
        if end is None:
            raise TransportError(f"{self._service.name} is answered already")
        self._server.tell_call(
            self._service, ObservationKind.RESPONSE_SENT, result, self.client, self._call
        )
        end(result)


class _Client:
    def __init__(self, node, service):
        self._node, self._service = node, service

    def call(self, request, done, timeout_s=5.0):
        request = _typed(request, self._service.request, self._service.type_name)
        node, service, call = self._node, self._service, next(self._node.calls)
        open_ = [done]

        def end(result):
            with _LOCK:
                mine = open_.pop() if open_ else None
            if mine is not None:
                node.tell_call(service, ObservationKind.RESPONSE_RECEIVED, result, node.node, call)
                node.post(lambda: mine(result))

        node.tell_call(service, ObservationKind.REQUEST_SENT, request, node.node, call)
        servers = [n for n in tuple(_NODES.values()) if service.name in n.served]
        if not servers:
            end(CallResult(CallOutcome.UNAVAILABLE, error=f"nobody serves {service.name}"))
            return
        late = CallResult(CallOutcome.TIMEOUT, error=f"{service.name}: no answer in time")
        node.after(timeout_s, lambda: end(late))
        server = servers[0]

        def receive():
            server.tell_call(service, ObservationKind.REQUEST_RECEIVED, request, node.node, call)
            handler = server.served[service.name]
            handler(_Request(server, service, request, node.node, call, end))

        server.post(receive)

    def call_and_wait(self, request, timeout_s=5.0):
        if threading.get_ident() == self._node.thread:
            raise TransportError("waiting on the executor would wait for ever")
        done = _Completion()
        self._node.waiting.append(done)
        self.call(request, done.set, timeout_s)
        result = done.wait(timeout_s + 1)
        self._node.waiting.remove(done)
        return result or CallResult(CallOutcome.UNAVAILABLE, error="closed")


class _Tap:
    def __init__(self, node, globs, handler):
        self.node, self.globs, self.handler = node, globs, handler

    is_complete = True

    def peers(self):
        return [name for name in _NODES if name != self.node.node]

    def problems(self):
        return []

    def is_contested(self, name):
        return False

    def ask(self, node, answered, within_s=1.0):
        self.node.post(lambda: answered(None))

    def take_dropped(self):
        return ()

    def blind_spots(self):
        return {}

    def close(self):
        self.handler = None


class Tiny:
    repair_s = 0.0
    reports_takes = False

    def __init__(self, node):
        self.node, self.thread = node, 0
        self.calls, self.subscribed, self.served, self.waiting = itertools.count(1), [], {}, []
        self._queue, self._timers, self._order = queue.Queue(), [], itertools.count()
        self._taps, self._watching, self._numbers = [], [], {}
        self._announced, self._closed = threading.Event(), False
        self._beside = []
        _NODES[node] = self

    def beside(self, node):
        if node in _NODES:
            raise TransportError(f"there is a node {node}")
        self._beside.append(Tiny(node))
        return self._beside[-1]

    def now_ns(self):
        return time.time_ns()

    def publisher(self, topic):
        return _Publisher(self, topic)

    def subscribe(self, topic, handler):
        self.subscribed.append((topic, handler))
        if topic.transient_local and topic.name in _TRANSIENT_LOCAL:
            self.post(lambda: handler(_TRANSIENT_LOCAL[topic.name]))

    def serve(self, service, handler):
        if service.name in self.served:
            raise TransportError(f"{service.name} is served already")
        self.served[service.name] = handler

    def client(self, service):
        return _Client(self, service)

    def serve_action(self, action, goal, cancel):
        actions.serve_action(self, action, goal, cancel)

    def action_client(self, action):
        return actions.action_client(self, action)

    def every(self, period_s, handler):
        return self._start(period_s, period_s, handler)

    def after(self, delay_s, handler):
        return self._start(delay_s, 0, handler)

    def _start(self, delay, period, handler):
        timer = _Timer(period, handler)
        due = time.monotonic() + delay
        self._queue.put(lambda: heapq.heappush(self._timers, (due, next(self._order), timer)))
        return timer

    def post(self, handler):
        self._queue.put(handler)

    def completion(self):
        return _Completion()

    def tick_complete(self):
        pass

    def wait_for_nodes(self, names, timeout_s):
        deadline, pause = time.monotonic() + timeout_s, threading.Event()
        while missing := [n for n in names if n not in _NODES or not _NODES[n]._announced.is_set()]:
            if time.monotonic() > deadline:
                return missing
            pause.wait(0.005)
        return []

    def watch_nodes(self, handler):
        self._watching.append(handler)

    def announce(self):
        self._announced.set()
        self._spread(True)

    def _spread(self, up):
        for node in tuple(_NODES.values()):
            for handler in node._watching:
                node.post(lambda h=handler: h(self.node, up))

    def tap(self, channels, handler):
        self._taps.append(_Tap(self, channels, handler))
        return self._taps[-1]

    def tell_call(self, service, kind, what, client, call):
        error = ""
        if isinstance(what, CallResult):
            error = "" if what.response is not None else f"{what.outcome}: {what.error}"
            what = what.response
        suffix = "_Request" if "request" in kind else "_Response"
        self.tell(service.name, kind, service.type_name + suffix, what, client, call, error)

    def tell(self, channel, kind, type_name, message, client="", call=0, error=""):
        with _LOCK:
            place = (channel, kind == ObservationKind.MESSAGE)
            number = self._numbers[place] = self._numbers.get(place, -1) + 1
            for node in tuple(_NODES.values()):
                for tap in node._taps:
                    names = (channel, channel.partition("/_action/")[0])
                    globs = tap.globs or ["*"]
                    if any(fnmatch.fnmatchcase(n, g) for n in names for g in globs):
                        now = time.time_ns()
                        observation = Observation(
                            stamp_ns=now,
                            received_ns=now,
                            channel=channel,
                            kind=kind,
                            type_name=type_name,
                            data=msgspec.to_builtins(message),
                            source=self.node,
                            sequence=number,
                            client=client,
                            call=call,
                            error=error,
                        )
                        node.post(lambda t=tap, o=observation: t.handler and t.handler(o))

    def spin(self, until=None):
        self.thread = threading.get_ident()
        while not self._closed and not (until and until()):
            wait = None
            if self._timers:
                wait = max(0.0, self._timers[0][0] - time.monotonic())
            try:
                self._queue.get(timeout=wait)()
            except queue.Empty:
                due, _, timer = heapq.heappop(self._timers)
                if timer.handler is not None:
                    if timer.period:
                        entry = (due + timer.period, next(self._order), timer)
                        heapq.heappush(self._timers, entry)
                    timer.handler()

    def close(self):
        if not self._closed:
            self._closed = True
            for other in self._beside:
                other.close()
            del _NODES[self.node]
            for waiting in self.waiting:
                waiting.set(None)
            self._spread(False)
            self._queue.put(lambda: None)
