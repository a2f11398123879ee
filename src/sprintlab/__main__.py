"""``python -m sprintlab`` is ``sprintlab``."""

from sprintlab.cli.main import main

if __name__ == "__main__":
    raise SystemExit(main())
