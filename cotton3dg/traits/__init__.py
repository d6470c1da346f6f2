# SPDX-License-Identifier: Apache-2.0
"""What is measured on a plant: which Gaussians it is, the bodies they show, and their sizes in cm."""
