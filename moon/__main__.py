"""``python -m moon``: the ``moon`` command."""

from moon.cli import main

main(prog_name="moon")
