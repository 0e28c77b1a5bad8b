"""Where camera and board stood: lens, pose, projection."""
