"""``python -m benchmarks.studies``: the same as ``pilotage monte-carlo``."""

from benchmarks.studies.cli import main

if __name__ == "__main__":
    main()
