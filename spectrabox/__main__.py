"""``python -m spectrabox``: the command line."""
from spectrabox.session.cli import main

if __name__ == "__main__":      # a process that a batch starts imports this and must not run it
    main()
