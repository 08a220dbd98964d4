"""Where what is judged comes from: a source stands before the feed in place of a transport.

* ``source``: what a monitor needs of a source;
* ``live``: a transport whose tap is opened before judging begins;
* ``recorded``: a source of which everything is recorded;
* ``played``: a recording;
* ``time_base``: by which of its times a recording that others made is judged (``time_choice``: which there
  are; ``time_survey``: what they are in all of it; ``recorded_clocks``: what they tell of nodes' clocks);
* ``on_time``: what a recorder received late, where it would have been received.
"""
