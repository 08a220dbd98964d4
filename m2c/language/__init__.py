"""Expressions: ECMAScript's grammar, types, meaning and conversions; SCXML's times and event names.

It knows neither machines nor files: what reads models (:mod:`m2c.model`) and what generated code runs on
(:mod:`m2c.runtime`) both stand on it.
"""
