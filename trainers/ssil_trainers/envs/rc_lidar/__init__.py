"""An RC car with a LiDAR between two walls."""
