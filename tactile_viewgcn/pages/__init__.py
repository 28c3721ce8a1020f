"""Pages and lines for people: the inspection of recordings, and the report of a run."""
