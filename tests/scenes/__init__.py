# SPDX-License-Identifier: Apache-2.0
"""Scenes with known truth, made by code, and what else several kinds of tests share."""
