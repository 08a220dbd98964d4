"""Fleets: many robots that run the same models, each in a namespace of its own, monitored by one process."""
