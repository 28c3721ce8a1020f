"""Read recordings as users have them, with one module for each format of files."""
