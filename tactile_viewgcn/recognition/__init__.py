"""The trained recogniser, its file, and predictions frame by frame."""
