"""Frames to learn from: above baseline, filtered, split, balanced."""
