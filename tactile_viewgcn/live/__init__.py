"""Answers while the hand still holds the object: streams of frames, and recordings as streams."""
