"""``python -m benchmarks.likelihood``: the command alone."""

from benchmarks.likelihood.cli import main

if __name__ == "__main__":
    main()
