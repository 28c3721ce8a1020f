"""What stands between the stages, as tables of columns: recordings, frames, views."""
