"""The virtual glove: a simulated hand grasps simulated objects. Start at `simulation.py`."""
