"""Trials on the test side, their statistics and report."""
