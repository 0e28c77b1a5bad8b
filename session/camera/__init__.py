"""What the camera commands read and write."""
