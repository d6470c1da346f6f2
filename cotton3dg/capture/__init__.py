"""Frames and poses, judged by themselves: the quality of frames, which to take and to match, how much is covered."""
