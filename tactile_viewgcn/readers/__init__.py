"""Recordings as they come: one file a format, each checked as it is read."""
