"""Recordings of any source as one table of raw counts."""
