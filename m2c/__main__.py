"""``python -m m2c``: the ``m2c`` command."""

from m2c.cli import main

main(prog_name="m2c")
