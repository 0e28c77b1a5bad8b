"""The chart in a photo: detection, verdict, patch statistics."""
