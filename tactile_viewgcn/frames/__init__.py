"""The way from recordings to the frames that a system learns from."""
