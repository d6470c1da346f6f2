# SPDX-License-Identifier: Apache-2.0
"""Structure from motion: features, pairs and matches, the mapper, lost images brought back, the lens."""
