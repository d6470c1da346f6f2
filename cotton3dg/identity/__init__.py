# SPDX-License-Identifier: Apache-2.0
"""Which plant a video shows: the codes on printed cards, the vote of many frames, and safe names of folders."""
