# SPDX-License-Identifier: Apache-2.0
"""Bolls in single images: by the bolls' network, or by networks with the user's own weights."""
