"""A learnt prior on reflectances: mixture, posterior, draws, training, and tables for pictures."""
