"""What is no stage: each command's own loading, calling and saving, below the command line."""
