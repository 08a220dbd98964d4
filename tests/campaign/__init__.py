"""The campaign: systems made at random, run under conditions made at random, judged, and never falsely accused."""
