# SPDX-License-Identifier: Apache-2.0
"""Data types that every layer shares: cameras, Gaussians, masks, bolls, scale and traits."""
