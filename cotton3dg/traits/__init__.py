# SPDX-License-Identifier: Apache-2.0
"""Measures a plant: finds its Gaussians, the bodies that they show, and their sizes in cm."""
