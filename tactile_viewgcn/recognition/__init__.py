"""The trained recogniser: its choice, calibration and file, and its answers to new recordings."""
