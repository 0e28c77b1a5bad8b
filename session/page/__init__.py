"""The local page of a session: photos with marks, the run, and new shots of a watched folder."""
