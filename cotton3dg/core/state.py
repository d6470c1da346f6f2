"""What became of a stage, of a plant in a batch or of a setting in a study, in one vocabulary."""

from enum import StrEnum


class State(StrEnum):
    """One word each; tables and `status --json` have them as they stand here."""

    DONE = "done"
    FAILED = "failed"
    STALE = "stale"
    """Done, but it would be another result now."""
    MISSING = "missing"
    """Never done."""
    WAITING = "waiting"
    """Not tried yet."""
    SKIPPED = "skipped"
    """Not tried, and it will not be."""
