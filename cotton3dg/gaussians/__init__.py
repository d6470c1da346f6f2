# SPDX-License-Identifier: Apache-2.0
"""The Gaussian model: the checked face of the native core, spherical harmonics, views and how good a render is."""
