"""Pages to look at: report.html of a plant and index.html of a batch, made of the files of the workspace only."""
