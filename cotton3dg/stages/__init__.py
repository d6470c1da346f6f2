"""One module a stage: load the inputs, call pure functions, save the outputs. Stages meet in files only.

Each module has

    VERSION: int                                    raised when the same inputs give another result
    def inputs(workspace) -> list[Path]             files and folders that the result depends on
    def run(workspace, options, progress) -> StageOutcome

and writes through `workspace.writing(stage)`. `pipeline.py` calls them and decides what is stale.
"""
