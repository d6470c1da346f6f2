# SPDX-License-Identifier: Apache-2.0
"""From the Gaussians of a plant to its map: wood, graph, skeleton, branches in order, fruiting positions, thickness."""
