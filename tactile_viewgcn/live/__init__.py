"""Answers while the hand still holds the object: streams of frames, and recordings played back."""
