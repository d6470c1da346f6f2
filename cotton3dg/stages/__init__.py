"""One module a stage: load the inputs, call pure functions, save the outputs. Stages meet in files only.

Each module ends with STAGE, which says all that others know of it: version, inputs, needs, cost (`stage.py`). It writes
through `workspace.writing(stage)`. `pipeline.py` runs them, `staleness.py` decides what is to be made again.
"""
