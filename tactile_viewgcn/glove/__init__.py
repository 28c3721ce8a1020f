"""The virtual glove: a simulated hand grasps simulated objects and writes recordings. Start at `simulation.py`."""
