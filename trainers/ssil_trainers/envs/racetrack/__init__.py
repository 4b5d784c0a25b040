"""One car on highway-env's racetrack, and its vectorized twin."""
