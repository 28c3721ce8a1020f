"""Studies: a YAML file for each question, run as DVC experiments by `python -m studies NAME`."""
