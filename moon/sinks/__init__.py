"""Where verdicts go: a topic, a file."""
