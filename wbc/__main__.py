"""``python -m wbc``: the command line where the script ``wbc`` is not on the path."""

from wbc.cli import main

if __name__ == "__main__":
    main()
