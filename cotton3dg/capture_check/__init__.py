"""Whether a film will do, while the plant still stands: what a first look shows, and what to film again."""
