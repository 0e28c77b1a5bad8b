"""``python -m spectrabox``: the command line."""
from spectrabox.session.cli import main

main()
