"""The state of a stage, of a plant in a batch or of a setting in a study, in one vocabulary."""

from enum import StrEnum


class State(StrEnum):
    """One word for each state; tables and `status --json` show these words."""

    DONE = "done"
    FAILED = "failed"
    STALE = "stale"
    """Done, but a new run would give another result."""
    MISSING = "missing"
    """Never done."""
    WAITING = "waiting"
    """Not tried yet."""
    SKIPPED = "skipped"
    """Not tried, and it will not be."""
