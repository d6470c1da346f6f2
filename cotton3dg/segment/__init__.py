# SPDX-License-Identifier: Apache-2.0
"""From masks to Gaussians: which of them each mask of each view shows."""
