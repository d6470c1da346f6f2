# SPDX-License-Identifier: Apache-2.0
"""From images to Gaussians: the share of lint of each Gaussian, or the Gaussians that each mask shows."""
