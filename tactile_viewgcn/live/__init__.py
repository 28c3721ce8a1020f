"""Live answers: a stream of frames, as a glove sends them, is answered while the hand holds."""
