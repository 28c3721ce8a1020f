"""Define the tables that the stages pass on: recordings, frames, views."""
