"""Where tests find the shared evaluation data that lies beside the checkout."""

from pathlib import Path

SHARED = Path(__file__).resolve().parents[2] / "shared" / "data"


def shared_data(relative: str) -> Path:
    """The path of a file or folder of the evaluation data; fails with a clear message where it is missing."""
    path = SHARED / relative
    if not path.exists():
        message = f"evaluation data missing: {path} (tests expect the folder 'shared' beside the checkout)"
        raise FileNotFoundError(message)
    return path
