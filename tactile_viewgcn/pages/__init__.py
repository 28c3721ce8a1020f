"""Pages and lines for people: an inspection of recordings, the report of a run."""
