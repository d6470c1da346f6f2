"""Commands that are not stages: each one's own loading, calling and saving, below the command line."""
