"""The model oracle: whether what was observed is what the model does, in some possible order.

A model is a timed automaton with data. Some of what it does is observed with the time at which it
happened (*fixed points*: what its node received, sent and published); some is not (when it took a message
of a topic, that a timer rang, what it drew at random). The oracle keeps the set of all states in which the
machine can be after what was observed so far: a state of the determinised automaton, made when it is needed
(Tripakis, *Fault diagnosis for timed automata*, FTRTFT 2002; Krichen and Tripakis, *Conformance testing for
real-time systems*, Formal Methods in System Design 34, 2009). Each of them is a *hypothesis*. Where none
is left, the model is violated, and the last ones are the explanation. Times of timers are intervals;
hypotheses that differ in these alone become one, with the hull of both: that can hide a fault, and never
makes one up. ``docs/oracle.md`` says the same at length.

The search, by composition; a module uses only those above it:

* ``bounds``: what is assumed of the middleware, and how many hypotheses are followed;
* ``calls``: calls, as their two ends know them;
* ``trace_events``: what an observation is to the machine, an input or an output;
* ``readers``: what makes that of the observations of one part of an interface;
* ``channels``: which of them reads what comes from a source, on a channel;
* ``source_streams``: what comes from there, with its numbers;
* ``evidence``: who shows that something is missing of what the machine takes, for every kind of input;
* ``unknowns``: values of which only a range is known, and when a value is what was expected;
* ``steps``, ``expressions``, ``compiling``, ``program``: one step, and the machine ready to be stepped;
* ``state``: hypotheses, which are values, and the goals in them;
* ``successors``: a hypothesis after one step that is not seen;
* ``beginnings``: the first hypotheses;
* ``inputs``: a hypothesis after what the machine took and reported;
* ``merging``: one hypothesis for several, where there are too many;
* ``outputs``: which hypotheses an output leaves;
* ``deterministic``: what comes next without a search, where only one thing can have happened;
* ``search``: the set of hypotheses, from one fixed point to the next;
* ``differing``: where two values differ, the first place first;
* ``explain``: why none is left.

What is concluded from it:

* ``in_transit``: what others sent, until the machine's node has it;
* ``confirmation``: violations until no lost observation can be the reason; the verdict as it stands.

The judge, which is handed all that happened in order, and who hands it over:

* ``resynchronisation``: where to begin in the middle of a run;
* ``model_oracle``: the judge; what cannot be, and what time brings about;
* ``delivery``: up to when all was received, what is held until then, and as of when messages are handed over;
* ``shared``: what the oracles of one monitor share;
* ``oracle``: what is received; all of the above in one object.
"""
