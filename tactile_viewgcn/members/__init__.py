"""The members of the classifier on the sensors, one file each, and what they share."""
