"""Hold the tables that the stages pass on: recordings, frames, views."""
