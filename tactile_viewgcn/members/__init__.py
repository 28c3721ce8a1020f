"""The members of the classifier on the sensors, one file each, and the code that they share."""
