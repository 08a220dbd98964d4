"""Event time: observations arrive late, twice or not at all, and judges are handed them in order.

How far a judge can be handed what concerns it is its *watermark* (Akidau et al., *The Dataflow Model*,
VLDB 2015): all that is stamped up to it has been received, or is known to be missing. It is decided by the
first of these that applies (decisions 13, 29 and 30):

1. *complete by number*: nodes number all that they report, in order (``progress``);
2. *complete by asking*: a node says up to which number it has reported everything (``asking``);
3. *bounded lateness*: nothing is received later than the latency bound after its stamp
   (``clock``).

* ``intake``: what a tap hands over, made fit for judges (``reception``: stamps, types, sources);
* ``lives``: which life of a node an observation is of;
* ``numbers``: what was received twice, and what was not received, by the numbers of a channel;
* ``nodes``: up to when all that several nodes reported has been received (``progress``: of one);
* ``unreceived``: what of that may be missing, and undo a violation;
* ``reachability``: whether nodes could be reached, or a network was cut;
* ``held``: what is not handed over yet, in order of stamps;
* ``window``: hands a judge in order what is received late, and holds back what is not certain;
* ``clock``: the clock of the judges, never ahead of what can have been received;
* ``asking``: asks nodes how far they have reported, where only that stands in the way.
"""
