"""Studies: a YAML file a question, run as DVC experiments by `python -m studies NAME`."""
