# SPDX-License-Identifier: Apache-2.0
"""Pages to look at: report.html of a plant and index.html of a batch, made only from the files of the workspace."""
