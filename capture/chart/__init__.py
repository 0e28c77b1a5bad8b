"""The chart in a photo: found, judged and read."""
